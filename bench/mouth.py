"""How far a mouth is from the idle loop's, measured on pictures as a viewer gets them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.engine.background import Background

BLOCK = 8
"""Pixels a side of the blocks by which the frame of the loop is recognised."""
CLOSED = 1.5
"""Levels of the default avatar: its idle pictures keep below 1 through the live encoder, half of speech is above 7."""


class MouthGauge:
    """Compares pictures with the loop. What the picture shows of the head's motion is recognised, not told.

    Args:
        background: the avatar's.
    """

    def __init__(self, background: Background) -> None:
        loop = background.pictures[:-1]
        height, width = loop.shape[1] * 2 // 3, loop.shape[2]
        region = background.region
        self._rows = slice(region.y, region.y + region.height)
        self._columns = slice(region.x, region.x + region.width)
        self._mouths = loop[:, self._rows, self._columns].astype(np.float32)
        self._masks = np.stack([background.posed_mask(index)[0] for index in range(len(loop))])
        self._weights = self._masks.sum((1, 2))
        outside = np.ones((height, width), np.float32)
        outside[self._rows, self._columns] = 0
        self._outside = _blocks(outside) == 1
        self._heads = np.stack([_blocks(picture[:height])[self._outside] for picture in loop])

    def loop_frame(self, luma: NDArray[np.uint8]) -> int:
        """The frame of the loop that a picture resembles most outside of the mouth."""
        return int(((self._heads - _blocks(luma)[self._outside]) ** 2).sum(1).argmin())

    def __call__(self, luma: NDArray[np.uint8]) -> float:
        """Mean difference to the mouth at rest, in levels of luma: near 0 is closed.

        Args:
            luma: (H, W) of the whole picture.
        """
        frame = self.loop_frame(luma)
        gap = np.abs(luma[self._rows, self._columns] - self._mouths[frame]) * self._masks[frame]
        return float(gap.sum() / self._weights[frame])


def _blocks(luma: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.float32]:
    height, width = (side // BLOCK for side in luma.shape)
    cut = luma[: height * BLOCK, : width * BLOCK].reshape(height, BLOCK, width, BLOCK)
    means: NDArray[np.float32] = cut.mean((1, 3), dtype=np.float32)
    return means
