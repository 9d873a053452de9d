"""The sound of a stream: pieces of speech on the stream's clock, and silence where there is none."""

from __future__ import annotations

from collections import deque

import numpy as np
import soxr
from numpy.typing import NDArray

from app.stream.clock import SAMPLE_RATE

FADE_SAMPLES = SAMPLE_RATE // 50
"""An interrupted sound fades out in 20 ms; cut off at once it would click."""

Samples = NDArray[np.float32]


def resample(samples: Samples, rate: int, length: int) -> Samples:
    """Bring a whole piece to 48 kHz.

    Args:
        samples: mono, float32, shape (n,).
        rate: its samples a second.
        length: samples wanted. The caller counts the time of all pieces exactly, so that rounding does not add up;
            what the resampler makes is cut or padded by the odd sample.

    Returns:
        float32, shape (length,).
    """
    made = samples if rate == SAMPLE_RATE else soxr.resample(samples, rate, SAMPLE_RATE)
    exact = np.zeros(length, np.float32)
    count = min(length, len(made))
    exact[:count] = made[:count]
    return exact


class Soundtrack:
    """Pieces of 48 kHz mono sound, each at its sample of the stream's clock. Used by one thread.

    Bounded by its caller: the speech of an utterance is made only a few pieces ahead.
    """

    def __init__(self) -> None:
        self._pieces: deque[tuple[int, Samples]] = deque()

    @property
    def end(self) -> int:
        """The sample after the last piece; 0 if there is none."""
        return self._pieces[-1][0] + len(self._pieces[-1][1]) if self._pieces else 0

    def add(self, position: int, samples: Samples) -> None:
        """Put a piece at sample `position`.

        Raises:
            ValueError: it would overlap the piece before.
        """
        if self._pieces and position < self.end:
            raise ValueError(f"sound at sample {position} overlaps the piece that ends at {self.end}")
        if len(samples):
            self._pieces.append((position, samples))

    def read(self, position: int, count: int) -> Samples:
        """`count` samples from `position` on; what lies before `position + count` is forgotten."""
        block = np.zeros(count, np.float32)
        while self._pieces and self._pieces[0][0] < position + count:
            start, samples = self._pieces[0]
            end = start + len(samples)
            first, last = max(start, position), min(end, position + count)
            if first < last:
                block[first - position : last - position] = samples[first - start : last - start]
            if end > position + count:
                break
            self._pieces.popleft()
        return block

    def cut(self, position: int) -> int:
        """Fade out from `position` on and forget the rest; returns the sample after which there is silence."""
        tail = self.read(position, FADE_SAMPLES)
        self._pieces.clear()
        if not tail.any():
            return position
        fade = np.linspace(1.0, 0.0, FADE_SAMPLES, dtype=np.float32)
        self._pieces.append((position, tail * fade))
        return position + FADE_SAMPLES
