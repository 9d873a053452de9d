"""Films for the tests: Mary's own pictures, still, moving in a known way, speaking; written by PyAV."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.video.reformatter import ColorRange, Colorspace
from numpy.typing import NDArray

from app.align.transcript import read_transcript
from app.engine.frame import from_rgb, planes
from app.speech import SILENCE, Phone

ROOT = Path(__file__).resolve().parents[3]
MARY = ROOT / "avatars" / "mary"
IDLE = MARY / "recording"
MOVING_HEAD = ROOT / "tests" / "data" / "moving_head"
FPS = 25

Rgb = NDArray[np.uint8]
Array = NDArray[np.float64]


@cache
def idle() -> tuple[Rgb, ...]:
    """Mary's idle loop, 512x512: the head moves, nobody speaks."""
    return tuple(_frames(IDLE / "idle.mkv"))


@cache
def moving_head() -> tuple[Rgb, ...]:
    """48 pictures, 320x320: see the README beside them."""
    return tuple(_frames(MOVING_HEAD / "clip.mkv"))


@cache
def speaking() -> tuple[Rgb, ...]:
    """Mary's head, quite still, 320x320, saying the beginning of her recording (frames 0 to 200 of it)."""
    first = islice(_frames(MARY / "recording" / "recording.mp4"), 200)
    return tuple(cv2.resize(whole, (320, 320), interpolation=cv2.INTER_AREA).astype(np.uint8) for whole in first)


def spoken(frames: int, first: int = 0) -> tuple[Phone, ...]:
    """The phones of some frames of Mary's recording."""
    start, end = first / FPS, (first + frames) / FPS
    said = read_transcript(MARY / "recording" / "recording.TextGrid").alignment(28.48).phones
    return tuple(
        Phone(phone.symbol, max(phone.start, start) - start, min(phone.end, end) - start)
        for phone in said
        if phone.end > start and phone.start < end
    )


def silence(frames: int) -> tuple[Phone, ...]:
    return (Phone(SILENCE, 0.0, frames / FPS),)


def vowel(frames: int) -> tuple[Phone, ...]:
    """One long vowel between short silences."""
    end = frames / FPS
    return (Phone(SILENCE, 0.0, 0.4), Phone("AA", 0.4, end - 0.2), Phone(SILENCE, end - 0.2, end))


def places(folder: Path, names: Iterable[str], kind: str = "landmarks") -> Array:
    """(T, N, 2) where landmarks of a clip are in every picture, in OpenCV's coordinates: centres are whole numbers."""
    poses: list[dict[str, Any]] = json.loads((folder / "pose.json").read_text())["poses"]
    return np.array([[pose[kind][name] for name in names] for pose in poses]) - 0.5


def luma_of(rgb: Rgb) -> NDArray[np.uint8]:
    return planes(from_rgb(rgb))[0]


def similarity(
    x: float = 0, y: float = 0, turn: float = 0, scale: float = 1, about: tuple[float, float] = (0, 0)
) -> Array:
    """(2, 3): turned by degrees and made larger about a point, then moved."""
    c, s = scale * np.cos(np.radians(turn)), scale * np.sin(np.radians(turn))
    linear = np.array([[c, -s], [s, c]])
    return np.hstack([linear, (np.array(about) - linear @ np.array(about) + (x, y))[:, None]])


def warped(rgb: NDArray[np.uint8], pose: Array, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """What was at p is at pose(p)."""
    size = size or (rgb.shape[1], rgb.shape[0])
    return cv2.warpAffine(rgb, pose, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE).astype(np.uint8)


def write_film(
    path: Path, pictures: Sequence[Rgb], *, times: Sequence[float] | None = None, rate: int | Fraction = FPS,
    options: dict[str, str] | None = None,
) -> Path:  # fmt: skip
    """H.264 of RGB pictures, BT.709, limited range, very finely quantised; `times` (seconds) makes its rate vary."""
    height, width = pictures[0].shape[:2]
    with av.open(str(path), "w") as output:
        stream = output.add_stream("libx264", rate=rate, options={"preset": "ultrafast", "crf": "4", **(options or {})})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.colorspace, stream.codec_context.color_range = Colorspace.ITU709, ColorRange.MPEG
        if times is not None:
            stream.time_base = stream.codec_context.time_base = Fraction(1, 90_000)
        for number, rgb in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(from_rgb(rgb), format="yuv420p")
            frame.colorspace, frame.color_range = Colorspace.ITU709, ColorRange.MPEG
            if times is not None:
                frame.pts, frame.time_base = round(times[number] * 90_000), Fraction(1, 90_000)
            output.mux(stream.encode(frame))
        output.mux(stream.encode(None))
    return path


def _frames(path: Path) -> list[Rgb]:
    with av.open(str(path)) as container:
        return [
            frame.to_ndarray(format="rgb24", src_colorspace=Colorspace.ITU709).astype(np.uint8)
            for frame in container.decode(video=0)
        ]
