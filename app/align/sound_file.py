"""Sound from a file of the caller's: WAV of any kind, and what else FFmpeg decodes, mixed to one channel."""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

import av
import numpy as np
from numpy.typing import NDArray

from app.errors import InputError, TooLong

SLOWEST, FASTEST = 8_000, 96_000
"""Samples a second that are taken."""

FORMATS = "wav,w64,aiff,caf,au,flac,mp3,ogg,aac,mov,mp4,matroska,webm,avi,flv,mpeg,mpegts"
"""FFmpeg's readers that are tried. Not those of playlists, which open further files and addresses."""

Samples = NDArray[np.float32]


def read_sound(source: Path | BinaryIO, *, longest: float = float("inf"), name: str = "") -> tuple[Samples, int]:
    """Decode a sound file, or the sound of a video.

    Args:
        source: a path, or a file opened for reading bytes that can be sought in.
        longest: seconds that are taken.
        name: what messages call it; a path's own name by default.

    Returns:
        mono float32 in [-1, 1], shape (n,), and its samples a second.

    Raises:
        InputError: it is no sound, is damaged, is empty, or has a rate outside of 8 to 96 kHz.
        TooLong: it is longer.
    """
    called = name or (str(source) if isinstance(source, Path) else "the file")
    try:
        with av.open(
            str(source.absolute()) if isinstance(source, Path) else source,
            "r",  # not the file's own mode: uploads are temporary files, open for writing
            options={"format_whitelist": FORMATS, "protocol_whitelist": "file"},
        ) as container:
            samples, rate = _decoded(container, longest, called)
    except (OSError, av.FFmpegError, ValueError) as error:  # ValueError: PyAV's own, of files that it cannot map
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"{called} cannot be read as sound: {reason}", field="audio", advice="WAV, FLAC, MP3, Ogg and M4A are read."
        ) from error
    if not len(samples):
        raise InputError(f"{called} is empty: it has no sound", field="audio")
    if not np.isfinite(samples).all():
        raise InputError(f"{called} has samples that are no numbers", field="audio")
    peak = float(np.abs(samples).max())
    if peak > 1.0:  # floats, or channels that add up
        samples /= np.float32(peak)
    return samples, rate


def _decoded(container: Any, longest: float, called: str) -> tuple[Samples, int]:
    if not container.streams.audio:
        raise InputError(f"{called} has no sound in it", field="audio")
    stream = container.streams.best("audio") or container.streams.audio[0]
    rate = stream.rate or 0
    if not SLOWEST <= rate <= FASTEST:
        raise InputError(
            f"{called} has {rate:,} samples a second", field="audio", advice="From 8,000 to 96,000 are taken."
        )
    resampler = av.AudioResampler(format="flt", layout="mono", rate=rate)
    parts: list[Samples] = []
    count = 0
    for frame in container.decode(stream):
        for part in resampler.resample(frame):
            parts.append(part.to_ndarray()[0])
            count += len(parts[-1])
        if count > longest * rate:
            raise TooLong(
                f"{called} is longer than {longest:g} s", field="audio", advice="Say it in parts, one after another."
            )
    parts += [part.to_ndarray()[0] for part in resampler.resample(None)]
    return np.concatenate([*parts, np.zeros(0, np.float32)]).astype(np.float32), rate
