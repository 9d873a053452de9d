"""The clips of a pack: the lossless loop that the engine reads, and the loop that browsers play."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace
from numpy.typing import NDArray

BT709 = 1
"""ITU-T H.273: colour primaries, transfer characteristics and matrix coefficients of BT.709 are all 1."""


def write_clip(
    path: Path, pictures: NDArray[np.uint8], fps: float, *, container: str, codec: dict[str, str], **muxer: str
) -> None:
    """Encode pictures (n, H * 3 // 2, W) with H.264, tagged BT.709 limited range.

    Args:
        path: file to write.
        pictures: as `app.engine.frame` has them.
        fps: frames a second.
        container: FFmpeg's name of the file format.
        codec: options for libx264.
        muxer: options for the container.
    """
    height, width = pictures.shape[1] * 2 // 3, pictures.shape[2]
    rate = Fraction(fps).limit_denominator(1001)
    with av.open(str(path), "w", format=container, options={"fflags": "+bitexact", **muxer}) as output:
        stream = output.add_stream("libx264", rate=rate, options=codec)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        context = stream.codec_context
        context.color_range = ColorRange.MPEG
        context.colorspace = Colorspace.ITU709
        context.color_primaries = BT709
        context.color_trc = BT709
        context.thread_count = 1
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="yuv420p")
            frame.pts, frame.time_base = number, 1 / rate
            frame.color_range, frame.colorspace = ColorRange.MPEG, Colorspace.ITU709
            output.mux(stream.encode(frame))
        output.mux(stream.encode(None))


def write_loop(path: Path, pictures: NDArray[np.uint8], fps: float) -> None:
    """`loop.mkv`: lossless."""
    write_clip(path, pictures, fps, container="matroska", codec={"crf": "0", "preset": "slow"})


def write_idle(path: Path, pictures: NDArray[np.uint8], fps: float) -> None:
    """`idle.mp4`: visually lossless, fragmented, so that a page can play it as it is or append it over and over."""
    codec = {"crf": "14", "preset": "slow", "profile": "high", "bf": "0", "g": "25", "x264-params": "scenecut=0"}
    write_clip(path, pictures, fps, container="mp4", codec=codec, movflags="frag_keyframe+empty_moov+default_base_moof")
