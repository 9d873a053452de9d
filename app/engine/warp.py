"""Warps. The literal operator W of Fu 2011 (appendix A), and the mesh inversion and blend that serve.

A flow is a float32 array (H, W, 2) of displacements (x, y) in pixels.
"""

from __future__ import annotations

from functools import lru_cache
from typing import cast

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float32]


def sample(
    plane: Float, where: Float, *, smooth: bool = True, zero_outside: bool = False, out: Float | None = None
) -> Float:
    """plane(where): backward warp with cubic (or, if not `smooth`, linear) interpolation.

    Args:
        plane: (h, w) or (h, w, C).
        where: (H, W, 2) coordinates (x, y) in the plane; beyond its edge the edge goes on, or zero if `zero_outside`.
        out: (H, W) or (H, W, C), written if given.
    """
    interpolation = cv2.INTER_CUBIC if smooth else cv2.INTER_LINEAR
    border = cv2.BORDER_CONSTANT if zero_outside else cv2.BORDER_REPLICATE
    result = cv2.remap(plane, where, None, interpolation, dst=out, borderMode=border)  # type: ignore[call-overload]
    return cast(Float, result)


@lru_cache(maxsize=32)
def pixel_grid(width: int, height: int) -> Float:
    """(height, width, 2) coordinates (x, y) of every pixel; shared, read-only."""
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    grid = np.stack([x, y], -1)
    grid.setflags(write=False)
    return grid


@nb.njit(cache=True, nogil=True)
def forward_warp(image: Float, flow: Float, out: Float, hit: NDArray[np.bool_]) -> None:
    """W(image, flow): push every pixel to its rounded target, then fill holes (Fu 2011, A.1 and A.2).

    Args:
        image: (H, W, C).
        flow: (H, W, 2).
        out: (H, W, C), overwritten. Where two pixels land on one place the later in raster order wins, as printed.
        hit: (H, W), overwritten: which pixels were reached before holes were filled.
    """
    height, width, channels = image.shape
    hit[:] = False
    for y in range(height):
        for x in range(width):
            target_x = int(np.floor(x + flow[y, x, 0] + np.float32(0.5)))
            target_y = int(np.floor(y + flow[y, x, 1] + np.float32(0.5)))
            if 0 <= target_x < width and 0 <= target_y < height:
                hit[target_y, target_x] = True
                for c in range(channels):
                    out[target_y, target_x, c] = image[y, x, c]
    fill_holes(out, hit)


@nb.njit(cache=True, nogil=True)
def fill_holes(image: Float, hit: NDArray[np.bool_]) -> None:
    """Each hole becomes the mean of the nearest reached pixels in the four directions (Fu 2011, A.2).

    The figure takes "black" pixels for holes; an explicit mask does not mistake the dark of the mouth for one.
    """
    height, width, channels = image.shape
    for y in range(height):
        for x in range(width):
            if hit[y, x]:
                continue
            found = 0
            for c in range(channels):
                image[y, x, c] = np.float32(0)
            for direction in range(4):
                step_x = (1, -1, 0, 0)[direction]
                step_y = (0, 0, 1, -1)[direction]
                i, j = x + step_x, y + step_y
                while 0 <= i < width and 0 <= j < height and not hit[j, i]:
                    i += step_x
                    j += step_y
                if 0 <= i < width and 0 <= j < height:
                    found += 1
                    for c in range(channels):
                        image[y, x, c] += image[j, i, c]
            for c in range(channels):
                image[y, x, c] /= max(found, 1)


@nb.njit(cache=True, nogil=True)
def invert_mesh(target_x: Float, target_y: Float, step: int, layer: Float, out: Float, depth: Float) -> None:
    """Invert a forward map by drawing its triangle mesh: which texture point shows at each pixel.

    A fixed-point inversion does not converge at the lips, where a slit opens to 20 pixels; a mesh does not care. Where
    the mesh folds, the higher layer is in front, and a triangle turned over is behind one that is not.

    Args:
        target_x, target_y: (h, w), where mesh vertex (i, j), at texture point (i * step, j * step), is shown.
        step: texture pixels between vertices.
        layer: (h, w), larger is nearer to the viewer.
        out: (H, W, 2), texture coordinates shown at each pixel; pixels outside the mesh keep what they held.
        depth: (H, W), scratch.
    """
    rows, columns = target_x.shape
    height, width = depth.shape
    depth[:] = np.float32(-1e9)
    for j in range(rows - 1):
        for i in range(columns - 1):
            near = max(max(layer[j, i], layer[j, i + 1]), max(layer[j + 1, i], layer[j + 1, i + 1]))
            for half in range(2):
                if half == 0:
                    i0, j0, i1, j1, i2, j2 = i, j, i + 1, j, i, j + 1
                else:
                    i0, j0, i1, j1, i2, j2 = i + 1, j + 1, i, j + 1, i + 1, j
                x0, y0 = target_x[j0, i0], target_y[j0, i0]
                ax, ay = target_x[j1, i1] - x0, target_y[j1, i1] - y0
                bx, by = target_x[j2, i2] - x0, target_y[j2, i2] - y0
                area = ax * by - bx * ay
                if abs(area) < 1e-6:
                    continue
                z = near if area > 0 else near - np.float32(1000)
                left = max(0, int(np.ceil(x0 + min(np.float32(0), min(ax, bx)) - np.float32(1e-3))))
                right = min(width - 1, int(np.floor(x0 + max(np.float32(0), max(ax, bx)) + np.float32(1e-3))))
                top = max(0, int(np.ceil(y0 + min(np.float32(0), min(ay, by)) - np.float32(1e-3))))
                bottom = min(height - 1, int(np.floor(y0 + max(np.float32(0), max(ay, by)) + np.float32(1e-3))))
                inverse = np.float32(1) / area
                step_i, step_j = np.float32((i1 - i0) * step), np.float32((j2 - j0) * step)
                for y in range(top, bottom + 1):
                    dy = y - y0
                    for x in range(left, right + 1):
                        dx = x - x0
                        b = (dx * by - bx * dy) * inverse
                        c = (ax * dy - dx * ay) * inverse
                        if b >= -1e-3 and c >= -1e-3 and b + c <= 1.001 and z >= depth[y, x]:
                            depth[y, x] = z
                            out[y, x, 0] = i0 * step + b * step_i
                            out[y, x, 1] = j0 * step + c * step_j


@nb.njit(cache=True, nogil=True)
def halve_map(luma_map: Float, out: Float) -> None:
    """Texture coordinates for chroma at its siting, from those of luma.

    Args:
        luma_map: (H, W, 2), luma texture coordinates.
        out: (H / 2, W / 2, 2), chroma texture coordinates: chroma (i, j) lies at luma (2 i, 2 j + 1/2).
    """
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            out[y, x, 0] = (luma_map[2 * y, 2 * x, 0] + luma_map[2 * y + 1, 2 * x, 0]) * np.float32(0.25)
            mean = (luma_map[2 * y, 2 * x, 1] + luma_map[2 * y + 1, 2 * x, 1]) * np.float32(0.5)
            out[y, x, 1] = (mean - np.float32(0.5)) * np.float32(0.5)


@nb.njit(cache=True, nogil=True, fastmath=True)
def blend(base: NDArray[np.int16], mask: NDArray[np.uint8], texture: Float, out: NDArray[np.uint8]) -> None:
    """out = base / 64 + mask / 255 * texture, rounded and clipped; all (h, w), `out` may be a view of a picture."""
    base_unit, mask_unit, half = np.float32(1 / 64), np.float32(1 / 255), np.float32(0.5)
    low, high = np.float32(0), np.float32(255)
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            value = base[y, x] * base_unit + mask[y, x] * mask_unit * texture[y, x] + half
            out[y, x] = np.uint8(min(max(value, low), high))
