"""The sound of a sentence as trajectory models hear it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import soxr
from numpy.typing import NDArray

from app.engine.models.mfcc import RATE, mfcc
from app.errors import InputError

Float = NDArray[np.float32]

TRACK_STEP = 0.005
"""Seconds between two vectors of `Sound.track`."""


@dataclass(frozen=True)
class Sound:
    """Mono sound and where it lies on the clock of the frames.

    Attributes:
        samples: float32 in [-1, 1], shape (n,).
        rate: samples a second.
        start: seconds from frame 0 to the first sample; less than 0 if the sound began before. Outside is silence.

    Raises:
        InputError: a sample is not finite.
    """

    samples: Float
    rate: int
    start: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.samples).all():
            raise InputError("the sound holds numbers that are not finite", field="audio")

    @cached_property
    def heard(self) -> Float:
        """The samples at `app.engine.models.mfcc.RATE`."""
        if self.rate == RATE or not len(self.samples):
            return self.samples.astype(np.float32)
        resampled: Float = soxr.resample(self.samples, self.rate, RATE).astype(np.float32)
        return resampled

    def moved(self, by: float) -> Sound:
        """The same for a clock that begins `by` seconds later."""
        return Sound(self.samples, self.rate, self.start - by)

    def frames(self, count: int, fps: float) -> Float:
        """(count, 20) MFCC, one vector a frame: frame n hears 1 / fps seconds around n / fps."""
        return mfcc(self.heard, np.arange(count) / np.float64(fps) - self.start, window=1 / fps)

    def track(self, count: int, fps: float) -> Float:
        """MFCC every `TRACK_STEP`, in the middle of its step.

        Frame n stands for (n - 1/2) / fps to (n + 1/2) / fps: at 25 fps, rows 8 n to 8 n + 7 are those of frame n.

        Returns:
            (round(count / fps / TRACK_STEP), 20).
        """
        steps = round(count / fps / TRACK_STEP)
        centres = (np.arange(steps) + 0.5) * TRACK_STEP - 0.5 / fps - self.start
        return mfcc(self.heard, centres)
