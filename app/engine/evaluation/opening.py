"""How far the mouth is open, measured alike on recorded and on drawn pictures.

The opening is the distance between the lips in the middle of the mouth, followed by the flow from the reference
prototype. The two rows that are followed are those of the mouth box whose distance differs most between the prototypes:
the outer edges of upper and lower lip, where flow is sure (between the lips it is not, teeth and tongue come and go).
On Mary's recording, whose renderer's controls are known, a linear function of them explains 99.7 % of its variance; at
/m b p/ it is less than at rest, for lips that are pressed together are thin.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.engine.metrics import Window
from app.engine.mmm import MorphableModel
from app.engine.modes import Modes, densify
from app.engine.pack import FPS
from app.speech import Phone

Float = NDArray[np.float32]

HALF_WIDTH = 4
"""Columns to both sides of the middle that flow is averaged over."""
CLOSED = 0.2
"""Openings below this show closed lips."""
CLOSING = ("M", "B", "P")
"""Phones whose lips close."""
LEAST_CLOSING = 0.06
"""Seconds: shorter ones may fall between two pictures."""


@dataclass(frozen=True, slots=True)
class Lips:
    """Where the lips are followed, on the grid of the reference prototype.

    Attributes:
        upper, lower: rows.
        left, right: columns from and up to which flow is averaged.
        least, most: distance of the lips in the most closed and in the widest prototype, pixels.
    """

    upper: int
    lower: int
    left: int
    right: int
    least: float
    most: float

    @classmethod
    def of(cls, model: MorphableModel, window: Window) -> Lips:
        """The lips of a talker.

        Args:
            model: prototypes and their flows.
            window: rows and columns of the mouth box.
        """
        middle = (window[1].start + window[1].stop) // 2
        columns = slice(middle - HALF_WIDTH, middle + HALF_WIDTH + 1)
        moved = model.flows[:, window[0], columns, 1].mean(2)  # (N, rows)
        spread = np.triu((moved[:, None, :] - moved[:, :, None]).std(0))
        upper, lower = (int(row) for row in np.unravel_index(int(spread.argmax()), spread.shape))
        distance = moved[:, lower] - moved[:, upper] + (lower - upper)
        start = window[0].start
        return cls(
            start + upper, start + lower, columns.start, columns.stop, float(distance.min()),
            max(float(distance.max()), float(distance.min()) + 1e-3),
        )  # fmt: skip

    def opening(self, flow: Float) -> float:
        """0 for the most closed, 1 for the widest prototype.

        Args:
            flow: (H, W, 2) from the reference prototype to a picture.
        """
        upper, lower = (float(flow[row, self.left : self.right, 1].mean()) for row in (self.upper, self.lower))
        return (lower - upper + self.lower - self.upper - self.least) / (self.most - self.least)


@dataclass(frozen=True)
class LinearOpening:
    """The opening that mode coefficients stand for: what `Lips` finds in the flow that they make.

    Attributes:
        weights: (K,), zero for texture.
        base: opening of coefficients that are zero.
    """

    weights: NDArray[np.float64]
    base: float

    @classmethod
    def of_modes(cls, lips: Lips, modes: Modes) -> LinearOpening:
        """The opening is linear in the flow, and the flow in the coefficients."""

        def measured(coefficients: Float) -> float:
            return lips.opening(densify(modes.flow(coefficients), modes.width, modes.height))

        base = measured(np.zeros(modes.count, np.float32))
        weights = np.zeros(modes.count)
        for mode in range(modes.flow_count):
            weights[mode] = measured(np.eye(modes.count, dtype=np.float32)[mode]) - base
        return cls(weights, base)

    def of(self, coefficients: Float) -> NDArray[np.float64]:
        """(T,) openings of coefficients (T, K)."""
        return coefficients.astype(np.float64) @ self.weights + self.base


def closings(phones: Sequence[Phone], frames: int, lead: float) -> Iterator[slice]:
    """Frames of every phone that closes the lips and is long enough to be seen.

    Args:
        phones: of a passage, times from its first frame.
        frames: how many it has.
        lead: seconds by which the lips are ahead of the sound.
    """
    for phone in phones:
        if phone.symbol in CLOSING and phone.end - phone.start >= LEAST_CLOSING:
            first = max(0, int(np.floor((phone.start - lead) * FPS)))
            last = min(frames, int(np.ceil((phone.end - lead) * FPS)) + 1)
            if last > first:
                yield slice(first, last)


def closed(opening: NDArray[np.float64], when: Sequence[slice]) -> list[bool]:
    """Whether the lips close in each of these stretches of an opening (T,)."""
    return [bool(opening[stretch].min() < CLOSED) for stretch in when]
