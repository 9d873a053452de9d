"""The sound of a stretch of a video, on the clock of its picture: time 0 is its first picture that can be decoded."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float32]

RATE = 48_000
"""Samples a second."""
JITTER = 0.025
"""Seconds: timestamps that are off by less are rounded; the sound goes on without a seam."""


def passage_sound(video: Path, start: float, seconds: float) -> Samples:
    """Mono sound at `RATE`, in [-1, 1]; silence where the file has none or it cannot be decoded.

    Args:
        video: the file.
        start: seconds from its first picture.
        seconds: how much.
    """
    sound = np.zeros(round(seconds * RATE), np.float32)
    try:
        origin = _first_picture(video)
        for time, piece in _pieces(video):
            at = round((time - origin - start) * RATE)
            if at >= len(sound):
                break
            begin, end = max(at, 0), min(at + len(piece), len(sound))
            if end > begin:
                sound[begin:end] = piece[begin - at : end - at]
    except (OSError, av.FFmpegError):
        return sound
    clipped: Samples = np.clip(np.nan_to_num(sound), -1, 1)
    return clipped


def _first_picture(video: Path) -> float:
    """When the first picture is shown, seconds on the file's clock."""
    with av.open(str(video)) as container:
        for packet in container.demux(container.streams.video[0]):
            for frame in _decoded(packet):
                return float(frame.time or 0.0)
    return 0.0


def _pieces(video: Path) -> Iterator[tuple[float, Samples]]:
    """Sound in order, each piece with its time on the file's clock."""
    with av.open(str(video)) as container:
        if not container.streams.audio:
            return
        mixer, start, given = _mixer(), 0.0, 0
        heard = 0.0  # seconds of sound that went into the mixer
        for packet in container.demux(container.streams.audio[0]):
            for frame in _decoded(packet):
                time = start + heard if frame.time is None else float(frame.time)
                if not given or abs(time - start - heard) > JITTER:
                    mixer, start, given, heard = _mixer(), time, 0, 0.0
                heard += frame.samples / frame.sample_rate
                for mixed in mixer.resample(frame):
                    piece = mixed.to_ndarray()[0]
                    yield start + given / RATE, piece
                    given += len(piece)


def _mixer() -> Any:
    return av.AudioResampler("flt", "mono", RATE)


def _decoded(packet: Any) -> list[Any]:
    """The frames of a packet; none if it is damaged."""
    try:
        return list(packet.decode())
    except av.FFmpegError:
        return []
