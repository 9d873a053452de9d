"""What a viewer saw and heard: the mouth in every picture, and how loud the sound was when."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from bench.mouth import MouthGauge

Floats = NDArray[np.float64]

LEVEL_SAMPLES = 128
"""2.7 ms at 48 kHz; divides an AAC frame."""
LONGEST_GROUP = 8.5
"""Seconds before a picture at which a key frame is to be found: the service's longest distance, and some."""


@dataclass(frozen=True)
class Series:
    """Something measured again and again: `times` in seconds, rising, and its `values`; both of shape (n,)."""

    times: Floats
    values: Floats

    def within(self, start: float, end: float) -> Series:
        """The part from `start` to before `end`."""
        chosen = (self.times >= start) & (self.times < end)
        return Series(self.times[chosen], self.values[chosen])

    def later(self, seconds: float) -> Series:
        """The same, moved."""
        return Series(self.times + seconds, self.values)


@dataclass(frozen=True)
class Watched:
    """A stretch of a stream.

    Attributes:
        mouth: of every picture, see `MouthGauge`.
        sound: how loud it was, dB below full scale, at the beginning of each 2.7 ms.
        pictures: times of all pictures of the file, decoded or not.
    """

    mouth: Series
    sound: Series
    pictures: Floats


def level(samples: NDArray[Any], size: int = LEVEL_SAMPLES) -> Floats:
    """(n // size,) dB below full scale of `size` mono samples each."""
    cut = samples[: len(samples) // size * size].reshape(-1, size)
    loud: Floats = 10 * np.log10((cut.astype(np.float64) ** 2).mean(1) + 1e-12)
    return loud


def luma(picture: av.VideoFrame) -> NDArray[np.uint8]:
    """(H, W) of a decoded picture, a view."""
    plane = picture.planes[0]
    return np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[: picture.height, : picture.width]


def look(path: Path, gauge: MouthGauge, start: float = 0.0, end: float = float("inf")) -> Watched:
    """Decode a stretch of a file: pictures and sound from `start` to `end` on the file's clock."""
    mouth: list[tuple[float, float]] = []
    sound: list[tuple[float, float]] = []
    pictures = []
    with av.open(str(path)) as container:
        for packet in container.demux(*container.streams.video, *container.streams.audio):
            at = None if packet.pts is None else float(packet.pts * packet.time_base)
            if at is not None and packet.stream.type == "video":
                pictures.append(at)
            if at is not None and not start - LONGEST_GROUP <= at < end:
                continue
            for frame in packet.decode():
                if not start <= frame.time < end:
                    continue
                if isinstance(frame, av.VideoFrame):
                    mouth.append((frame.time, gauge(luma(frame))))
                else:
                    levels = level(frame.to_ndarray()[0])
                    sound += [
                        (frame.time + n * LEVEL_SAMPLES / frame.sample_rate, each) for n, each in enumerate(levels)
                    ]
    return Watched(series(mouth), series(sound), np.array(pictures))


def series(pairs: list[tuple[float, float]]) -> Series:
    """Of (time, value)."""
    times, values = np.array(pairs, np.float64).reshape(-1, 2).T
    return Series(times, values)
