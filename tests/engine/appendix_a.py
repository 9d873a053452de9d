"""Fu 2011, appendix A, written down as slowly and plainly as it is printed: the oracle of the engine's warps."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float32]


def warp(image: Float, flow: Float) -> Float:
    """W(I, C): A.1, then A.2. `image` is (H, W) or (H, W, 2), `flow` (H, W, 2)."""
    height, width = flow.shape[:2]
    pushed: dict[tuple[int, int], NDArray[np.float64]] = {}
    for j in range(height):
        for i in range(width):
            x = math.floor(float(np.float32(i) + flow[j, i, 0]) + 0.5)  # ROUND(i + dx(i, j))
            y = math.floor(float(np.float32(j) + flow[j, i, 1]) + 0.5)
            if 0 <= x < width and 0 <= y < height:
                pushed[x, y] = np.asarray(image[j, i], np.float64)
    warped = np.zeros(image.shape)
    for y in range(height):
        for x in range(width):
            warped[y, x] = pushed[x, y] if (x, y) in pushed else fill(pushed, x, y, width, height)
    return warped.astype(np.float32)


def fill(
    pushed: dict[tuple[int, int], NDArray[np.float64]], x: int, y: int, width: int, height: int
) -> NDArray[np.float64] | float:
    """The average of the closest pushed pixels in the four directions; nothing found is black."""
    found = []
    for ray in (
        [(i, y) for i in range(x + 1, width)],
        [(i, y) for i in range(x - 1, -1, -1)],
        [(x, j) for j in range(y + 1, height)],
        [(x, j) for j in range(y - 1, -1, -1)],
    ):
        hits = [place for place in ray if place in pushed]
        if hits:
            found.append(pushed[hits[0]])
    return np.mean(found, axis=0) if found else 0.0


def morph(images: Float, flows: Float, alpha: Float, beta: Float) -> Float:
    """I^morph = sum_i beta_i W(I_i, W(sum_j alpha_j C_j - C_i, C_i)): eq. 3.3 to 3.5 for images (N, H, W)."""
    synthesised = sum(weight * flow for weight, flow in zip(alpha, flows, strict=True))
    total = np.zeros(images.shape[1:])
    for image, flow, weight in zip(images, flows, beta, strict=True):
        reoriented = warp((synthesised - flow).astype(np.float32), flow)
        total += float(weight) * warp(image, reoriented)
    return total.astype(np.float32)
