"""The pictures of a video file at the avatar's frame rate: upright, in the house's colours, at most `LIMIT` large.

Any codec, size, rotation and (variable) frame rate that FFmpeg decodes. Frame n is the picture that is on the screen at
n / `FPS` seconds after the first one, or the next if that is nearer in time; where a camera dropped frames or a packet
is damaged, the last picture stays on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace, Interpolation

from app.engine.frame import Picture, planes
from app.engine.pack import FPS
from app.errors import TrainingFailed

LIMIT = (1280, 720)
"""Longest and shortest side, pixels: larger pictures are made smaller as they are decoded."""
SMALLEST = 96
"""Pixels: no side may be shorter."""
SCALER = int(Interpolation.BICUBIC) | 0x40000  # SWS_ACCURATE_RND: without it BT.601 comes out two levels too dark
LONGEST_GAP = 5.0
"""Seconds: after a longer hole in the time stamps the recording is taken to go on at once."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One picture of a video.

    Attributes:
        picture: (H * 3 // 2, W) uint8, as `app.engine.frame` has them. The next shot may reuse its memory.
        fresh: whether it is another picture than the one before, undamaged.
    """

    picture: Picture
    fresh: bool


def shots(path: Path) -> Iterator[Shot]:
    """The pictures of a video at `FPS`.

    Raises:
        TrainingFailed: no video, too small, or nothing of it can be decoded.
    """
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise TrainingFailed(f"{path.name} has no pictures in it")
            container.streams.video[0].thread_type = "AUTO"
            container.streams.video[0].thread_count = 1
            yield from _at_rate(path, _decoded(container))
    except (OSError, av.FFmpegError) as error:
        raise TrainingFailed(f"{path.name} cannot be decoded: {error.strerror}") from error


def _decoded(container: av.container.InputContainer) -> Iterator[tuple[float, av.VideoFrame]]:
    """Frames with their times in seconds from the first; damaged packets are passed over."""
    stream = container.streams.video[0]
    rate = float(stream.average_rate or stream.guessed_rate or FPS)
    first: float | None = None
    expected = 0.0
    for packet in container.demux(stream):
        try:
            found = packet.decode()
        except av.FFmpegError:
            continue
        for frame in found:
            time = frame.time if frame.time is not None else (first or 0.0) + expected
            if first is None:
                first = time
            elif not -0.5 / rate <= time - first - expected + 1 / rate <= LONGEST_GAP:
                first = time - expected  # a broken clock
            expected = time - first + 1 / rate
            yield time - first, frame


def _at_rate(path: Path, decoded: Iterator[tuple[float, av.VideoFrame]]) -> Iterator[Shot]:
    shown: tuple[float, av.VideoFrame] | None = None  # what is on the screen
    picture: Picture | None = None  # the same, once it was asked for
    tick, half = 0, 0.5 / FPS
    for time, frame in decoded:
        if shown is None:
            shown = time, frame
            continue
        # The next picture is shown at the ticks that are nearer to it, but never long before its time.
        while time - tick / FPS > min(half, abs(tick / FPS - shown[0])) - 1e-6:
            fresh = picture is None and not shown[1].is_corrupt
            picture = upright(shown[1], path) if picture is None else picture
            yield Shot(picture, fresh)
            tick += 1
        if not frame.is_corrupt:
            shown, picture = (time, frame), None
    if shown is None:
        raise TrainingFailed(f"{path.name} has no picture that can be decoded")
    if tick == 0 or (picture is None and tick / FPS - shown[0] < half - 1e-6):
        yield Shot(upright(shown[1], path), not shown[1].is_corrupt)


def upright(frame: av.VideoFrame, path: Path) -> Picture:
    """A decoded frame as the house has pictures: turned upright, BT.709 limited range, even sides, within `LIMIT`."""
    turns = round((frame.rotation or 0) / 90) % 4
    width, height = frame.width, frame.height
    if min(width, height) < SMALLEST:
        raise TrainingFailed(f"{path.name} is {width}x{height}: too small", advice=f"At least {SMALLEST} a side.")
    scale = min(1.0, LIMIT[0] / max(width, height), LIMIT[1] / min(width, height))
    width, height = round(width * scale / 2) * 2, round(height * scale / 2) * 2
    small = frame.reformat(
        width, height, "yuv420p", src_colorspace=_colorspace(frame), dst_colorspace=Colorspace.ITU709,
        src_color_range=_range(frame), dst_color_range=ColorRange.MPEG, interpolation=SCALER,
    )  # fmt: skip
    picture: Picture = np.ascontiguousarray(small.to_ndarray(), np.uint8)
    return picture if not turns else _turned(picture, turns)


def _colorspace(frame: av.VideoFrame) -> Colorspace:
    """What the file says, else what pictures of its size usually are."""
    said = int(frame.colorspace)
    known = {1: Colorspace.ITU709, 5: Colorspace.ITU601, 6: Colorspace.ITU601, 7: Colorspace.SMPTE240M}
    return known.get(said, Colorspace.ITU709 if frame.height >= 720 else Colorspace.ITU601)


def _range(frame: av.VideoFrame) -> ColorRange:
    full = frame.format.name.startswith(("yuvj", "rgb", "bgr", "gbr", "gray")) or int(frame.color_range) == 2
    return ColorRange.JPEG if full else ColorRange.MPEG


def _turned(picture: Picture, turns: int) -> Picture:
    """A picture turned anticlockwise by `turns` right angles."""
    turned = [np.rot90(plane, turns) for plane in planes(picture)]
    width = turned[0].shape[1]
    return np.concatenate([np.ascontiguousarray(plane).reshape(-1) for plane in turned]).reshape(-1, width)
