"""The clock of a stream: sound samples at 48 kHz lead, frame n belongs to sample n * 1,920 (25 fps)."""

from __future__ import annotations

import time
from collections.abc import Callable

SAMPLE_RATE = 48_000
FPS = 25
FRAME_SAMPLES = SAMPLE_RATE // FPS
BLOCK_SAMPLES = 960
"""Samples a tick: 20 ms, one Opus packet, half a frame."""
BLOCK_SECONDS = BLOCK_SAMPLES / SAMPLE_RATE


def first_frame_at(sample: int) -> int:
    """The first frame whose time is not before `sample`."""
    return -(-sample // FRAME_SAMPLES)


class StreamClock:
    """Maps media time (samples, frames; 0 = the start of the stream) to the time at which it leaves the server.

    There is no drift: the time of a sample is computed from its number, never summed up.

    Args:
        clock: seconds, monotonic; also the clock of the frame pool's deadlines.
        wall: seconds since 1970.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, wall: Callable[[], float] = time.time) -> None:
        self._clock = clock
        self.origin = clock()
        self._wall_origin = wall()

    def sample_release(self, sample: int) -> float:
        """When this sample leaves the server, seconds on `clock`."""
        return self.origin + sample / SAMPLE_RATE

    def frame_release(self, frame: int) -> float:
        """When this frame may leave the server, seconds on `clock`."""
        return self.origin + frame / FPS

    def due_sample(self, now: float | None = None) -> int:
        """The end of the sound that has to have left the server now: whole blocks, samples."""
        elapsed = (self._clock() if now is None else now) - self.origin
        # Half a microsecond of grace: a timer that fires exactly at a release time must not miss it by rounding.
        return (int((elapsed + 5e-7) / BLOCK_SECONDS) + 1) * BLOCK_SAMPLES

    def wall_ms(self, seconds: float) -> float:
        """When this moment of the stream leaves the server, milliseconds since 1970."""
        return 1000 * (self._wall_origin + seconds)
