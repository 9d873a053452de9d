"""Writes the clips."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import cast

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace
from numpy.typing import NDArray

from avatars.mary.studio.workspace import FPS

BT709 = 1
"""ITU-T H.273: colour primaries and transfer characteristics of BT.709 are both 1."""


def write_lossless(path: Path, pictures: Iterable[NDArray[np.uint8]]) -> None:
    """RGB pictures (H, W, 3) as they are: H.264 of RGB, which PyAV and FFmpeg read, browsers do not."""
    _write(path, pictures, "libx264rgb", "rgb24", {"qp": "0", "preset": "slow"}, None)


def write_fine(path: Path, pictures: Iterable[NDArray[np.uint8]], *, sound: Path | None = None, crf: int = 11) -> None:
    """RGB pictures (H, W, 3), no loss to be seen: H.264 4:4:4, BT.709; the sound, if any, as AAC."""
    _write(path, pictures, "libx264", "yuv444p", {"crf": str(crf), "preset": "medium"}, sound)


def _write(
    path: Path,
    pictures: Iterable[NDArray[np.uint8]],
    codec: str,
    pixels: str,
    options: dict[str, str],
    sound: Path | None,
) -> None:
    pictures = iter(pictures)
    first = next(pictures)
    muxer = {"fflags": "+bitexact"} | ({"movflags": "faststart"} if path.suffix == ".mp4" else {})
    with av.open(str(path), "w", options=muxer) as output:
        stream = cast(av.VideoStream, output.add_stream(codec, rate=FPS, options=options))
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = pixels
        if pixels != "rgb24":
            context = stream.codec_context
            context.color_range, context.colorspace = ColorRange.MPEG, Colorspace.ITU709
            context.color_primaries = context.color_trc = BT709
        audio = output.add_stream("aac", rate=_rate(sound), layout="mono", bit_rate=160_000) if sound else None
        count = 0
        for picture in chain([first], pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            if pixels != "rgb24":
                frame = frame.reformat(format=pixels, dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG)
            frame.pts, frame.time_base = count, Fraction(1, FPS)
            output.mux(stream.encode(frame))
            count += 1
        output.mux(stream.encode(None))
        if sound is not None and audio is not None:
            _add_sound(output, audio, sound, count / FPS)


def _rate(sound: Path) -> int:
    with av.open(str(sound)) as container:
        return container.streams.audio[0].rate


def _add_sound(output: av.container.OutputContainer, stream: av.AudioStream, sound: Path, seconds: float) -> None:
    """The sound's first seconds, in the stream's format."""
    with av.open(str(sound)) as container:
        for frame in container.decode(audio=0):
            if frame.time is not None and frame.time >= seconds:
                break
            output.mux(stream.encode(frame))
    output.mux(stream.encode(None))
