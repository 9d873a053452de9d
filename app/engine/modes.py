"""The serving form of the morphable model: linear modes of flow and of texture.

A mouth is one warp of one texture: the texture, on the grid of a wide-open mouth where teeth and tongue are seen at
full resolution, is a mean plus a few modes; so is the flow from that grid to the picture. The (alpha, beta) of the
paper map to these coefficients linearly (`app.engine.mmm`); being principal components, they are decorrelated, which
is what a trajectory model wants, and they do not grey out teeth as convex blends of prototypes do.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.engine.background import Background, Placement, Planes, chroma_map
from app.engine.warp import halve_map, invert_mesh, pixel_grid, sample

Float = NDArray[np.float32]

MESH_STEP = 2
"""Texture pixels between flow vertices: half resolution costs nothing in quality."""


@dataclass(frozen=True)
class Modes:
    """Flow and texture of a mouth as linear functions of its coefficients, flow's first.

    Attributes:
        width, height: of the crop and the texture grid, pixels.
        flow_mean: (h, w, 2) displacement of each mesh vertex from the texture grid to the crop, pixels.
        flow_modes: (KF, h, w, 2).
        texture_mean: (P,) luma, then both chroma planes at half resolution, flattened: P = width * height * 3 / 2.
        texture_modes: (KT, P).
        layer: (h, w) 0 inside the mouth, 1 on skin and lips: what is in front where the mesh folds.
        detail: (P,) what the loop's cleaner rendering has and the recording's frames lack; added to the texture except
            at the `STILL` pose.
    """

    width: int
    height: int
    flow_mean: Float
    flow_modes: Float
    texture_mean: Float
    texture_modes: Float
    layer: Float
    detail: Float

    @property
    def flow_count(self) -> int:
        """KF."""
        return len(self.flow_modes)

    @property
    def count(self) -> int:
        """K = KF + KT, coefficients of a mouth."""
        return len(self.flow_modes) + len(self.texture_modes)

    def flow(self, coefficients: Float) -> Float:
        """(h, w, 2) vertex displacements of one mouth's coefficients (K,)."""
        modes = self.flow_modes.reshape(self.flow_count, -1)
        moved: Float = (coefficients[: self.flow_count] @ modes).reshape(self.flow_mean.shape) + self.flow_mean
        return moved

    def texture(self, coefficients: Float, *, detail: bool) -> Planes:
        """Texture planes of one mouth's coefficients (K,)."""
        flat = coefficients[self.flow_count :] @ self.texture_modes
        flat += self.texture_mean
        if detail:
            flat += self.detail
        return split_texture(flat, self.width, self.height)


def split_texture(flat: Float, width: int, height: int) -> Planes:
    """Views of a flat texture (P,) as planes."""
    size, quarter = width * height, width * height // 4
    half = (height // 2, width // 2)
    return Planes(
        flat[:size].reshape(height, width),
        flat[size : size + quarter].reshape(half),
        flat[size + quarter :].reshape(half),
    )


def densify(vertices: Float, width: int, height: int) -> Float:
    """(H, W, 2) flow of every texture pixel, from the flow (h, w, 2) of the mesh vertices."""
    return sample(vertices.astype(np.float32), pixel_grid(width, height) / np.float32(MESH_STEP), smooth=False)


class ModeMouth:
    """Draws mouths from modes: two products, one mesh inversion straight into the head's pose, one remap a plane."""

    def __init__(self, modes: Modes, background: Background) -> None:
        self._modes = modes
        self._still = background.frames
        self._local = threading.local()
        self._size = (background.region.height, background.region.width)
        placement = Placement(background, MESH_STEP)
        self._shift = placement.shift + placement.vertices + modes.flow_mean
        self._flow_modes = np.ascontiguousarray(modes.flow_modes.reshape(modes.flow_count, -1))
        self._means = (modes.texture_mean + modes.detail, modes.texture_mean)  # in the loop, at the still pose
        origin = np.array(
            [background.region.x - background.crop.x, background.region.y - background.crop.y], np.float32
        )
        self._outside = pixel_grid(self._size[1], self._size[0]) + origin

    def draw(self, coefficients: Float, index: int, out: Planes) -> None:
        """See `app.engine.background.Mouth`."""
        count = self._modes.flow_count
        shown = (coefficients[:count] @ self._flow_modes).reshape(self._shift.shape[1:])
        shown += self._shift[index]
        flat = coefficients[count:] @ self._modes.texture_modes
        flat += self._means[int(index == self._still)]
        texture = split_texture(flat, self._modes.width, self._modes.height)
        where, half, depth = self._scratch()
        np.copyto(where, self._outside)
        invert_mesh(
            np.ascontiguousarray(shown[..., 0]), np.ascontiguousarray(shown[..., 1]), MESH_STEP, self._modes.layer,
            where, depth,
        )  # fmt: skip
        halve_map(where, half)
        for source, target, points in zip(texture.each(), out.each(), (where, half, half), strict=True):
            sample(source, points, out=target)

    def _scratch(self) -> tuple[Float, Float, Float]:
        found: tuple[Float, Float, Float] | None = getattr(self._local, "buffers", None)
        if found is None:
            height, width = self._size
            found = self._local.buffers = (
                np.empty((height, width, 2), np.float32),
                np.empty((height // 2, width // 2, 2), np.float32),
                np.empty((height, width), np.float32),
            )
        return found


def draw_crop(modes: Modes, coefficients: Float) -> Planes:
    """One mouth in the crop's own coordinates, without pose or detail: what analysis compares with the recording."""
    shown = modes.flow(coefficients)
    where = pixel_grid(modes.width, modes.height).copy()
    vertices = where[::MESH_STEP, ::MESH_STEP] + shown
    depth = np.empty((modes.height, modes.width), np.float32)
    invert_mesh(
        np.ascontiguousarray(vertices[..., 0]), np.ascontiguousarray(vertices[..., 1]), MESH_STEP, modes.layer, where,
        depth,
    )  # fmt: skip
    texture = modes.texture(coefficients, detail=False)
    half = chroma_map(where)
    drawn = (sample(source, points) for source, points in zip(texture.each(), (where, half, half), strict=True))
    return Planes(*drawn)
