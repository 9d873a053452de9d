"""How much the nose still moves in stabilised crops: what stabilisation leaves over."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.background import Box

Array = NDArray[np.float64]
Float = NDArray[np.float32]

PATCH = (0.12, 0.31, 0.145)
"""Half the width of the nose's patch, and how far its top and bottom are above the middle of the crop, in sides."""
STEPS = 8
"""Of Lucas and Kanade's registration."""


@dataclass(frozen=True, slots=True)
class NoseMotion:
    """Translation of the nose against the mean of its clip, pixels of the crop.

    Attributes:
        p95: 95th percentile of the distance.
        across, down: root mean square in both directions.
        frames: measured.
    """

    p95: float
    across: float
    down: float
    frames: int


def nose_patch(crop: Box, side: float) -> tuple[slice, slice]:
    """Rows and columns of a crop that show the nostrils.

    Args:
        crop: only its size matters.
        side: of the face box, pixels.
    """
    x, y = crop.width // 2, crop.height // 2
    half, top, bottom = (round(share * side) for share in PATCH)
    return slice(max(0, y - top), y - bottom), slice(max(0, x - half), min(crop.width, x + half))


def shifts(patches: Float) -> Array:
    """(n, 2) translation of each patch (n, h, w) against their mean, x and y, pixels.

    Each step solves for the shift that the mean's slopes explain (Lucas and Kanade 1981), apart from brightness and
    contrast.
    """
    mean = patches.mean(0).astype(np.float32)
    across = cv2.Sobel(mean, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    down = cv2.Sobel(mean, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    inner = (slice(2, -2), slice(2, -2))
    slopes = np.stack([across[inner].ravel(), down[inner].ravel(), mean[inner].ravel(), np.ones(mean[inner].size)], 1)
    slopes = slopes.astype(np.float64)
    solve = np.linalg.pinv(slopes)
    size = (mean.shape[1], mean.shape[0])
    found = np.zeros((len(patches), 2))
    for patch, shift in zip(patches.astype(np.float32), found, strict=True):
        for _ in range(STEPS):
            warp = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
            shown = cv2.warpAffine(
                patch, warp, size, flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
            )
            change = solve @ (shown - mean)[inner].ravel().astype(np.float64)
            shift -= change[:2]
    return found


def nose_motion(moved: list[Array]) -> NoseMotion:
    """Sum up the shifts (n, 2) of each clip."""
    every = np.concatenate(moved)
    across, down = np.sqrt((every**2).mean(0))
    distance = np.hypot(every[:, 0], every[:, 1])
    return NoseMotion(float(np.percentile(distance, 95)), float(across), float(down), len(every))
