"""A recording with the head at rest: mouth pictures, sound, phone times, and the material of the idle loop.

The folder holds

    recording/mouth.mkv or mouth/%05d.png    the mouth region of every frame, head pose fixed
    recording/box.json                       where it sits in the frame: x, y, w, h, fps, frame
    recording/still.png                      the whole frame at rest
    recording/phones.json                    [ARPAbet, start s, end s] lists
    recording/transcript.json                sentences with start and end
    recording/audio.wav                      mono
    idle/frames.mkv, idle/warp.npz           the loop, and its dense map from the still
    blink/                                   eye pictures at several degrees of closure
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.background import Box
from app.engine.frame import to_planes
from app.errors import TrainingFailed
from app.speech import PHONES, Phone


@dataclass(frozen=True)
class Sentence:
    """One sentence of the transcript (seconds of the recording)."""

    text: str
    start: float
    end: float


@dataclass(frozen=True)
class Recording:
    """A recording, read and checked.

    Attributes:
        folder: where it came from.
        crop: the mouth region in the frame.
        fps: frames a second.
        size: (width, height) of the whole frame.
        frames: (T, P) uint8: luma, then both chroma planes, of the mouth region of every frame.
        phones: gapless, over the whole recording.
        sentences: the transcript.
    """

    folder: Path
    crop: Box
    fps: float
    size: tuple[int, int]
    frames: NDArray[np.uint8]
    phones: tuple[Phone, ...]
    sentences: tuple[Sentence, ...]

    def spans(self) -> list[range]:
        """The frames of each sentence, cut in the middle of the pauses; together they cover the recording."""
        cuts = [0]
        for here, following in itertools.pairwise(self.sentences):
            cuts.append(round((here.end + following.start) / 2 * self.fps))
        cuts.append(len(self.frames))
        return [range(start, end) for start, end in itertools.pairwise(cuts)]

    def still(self) -> NDArray[np.uint8]:
        """The whole frame at rest, RGB."""
        return read_picture(self.folder / "recording" / "still.png")

    def loop(self) -> Iterator[NDArray[np.uint8]]:
        """The frames of the idle loop, RGB."""
        return read_clip(self.folder / "idle" / "frames.mkv")

    def loop_map(self) -> tuple[NDArray[np.float32], int]:
        """(L, rows, columns, 2) displacement from the loop's pixels to the still's, sampled every `step` pixels."""
        path = self.folder / "idle" / "warp.npz"
        try:
            with np.load(path, allow_pickle=False) as stored:
                return stored["warp"].astype(np.float32), int(stored["step"])
        except (OSError, KeyError, ValueError) as error:
            raise TrainingFailed(f"{path} is no pose map: {error}") from error


def read(folder: Path) -> Recording:
    """Read a recording.

    Raises:
        TrainingFailed: something is missing, unreadable or does not fit; says what and where.
    """
    box = read_json(folder / "recording" / "box.json")
    crop = Box(box["x"], box["y"], box["w"], box["h"])
    if any(side % 2 for side in (crop.x, crop.y, crop.width, crop.height)):
        raise TrainingFailed(f"{folder}/recording/box.json: 4:2:0 needs even numbers, got {box}")
    phones = _phones(folder / "recording" / "phones.json")
    sentences = tuple(
        Sentence(entry["text"], float(entry["start"]), float(entry["end"]))
        for entry in read_json(folder / "recording" / "transcript.json")
    )
    frames = np.stack(list(_mouth_frames(folder, crop)))
    missing = len(frames) / box["fps"] - phones[-1].end
    if abs(missing) > 0.5:
        raise TrainingFailed(
            f"{folder}: {len(frames)} frames last {len(frames) / box['fps']:.2f} s, the phones {phones[-1].end:.2f} s",
            advice="Frames and phones must be of the same recording.",
        )
    return Recording(folder, crop, float(box["fps"]), (box["frame"][0], box["frame"][1]), frames, phones, sentences)


def _mouth_frames(folder: Path, crop: Box) -> Iterator[NDArray[np.uint8]]:
    clip = folder / "recording" / "mouth.mkv"
    pictures = sorted((folder / "recording" / "mouth").glob("*.png"))
    if not clip.exists() and not pictures:
        raise TrainingFailed(f"{folder}/recording has neither mouth.mkv nor mouth/*.png")
    source = read_clip(clip) if clip.exists() else map(read_picture, pictures)
    for number, rgb in enumerate(source):
        if rgb.shape != (crop.height, crop.width, 3):
            raise TrainingFailed(
                f"{folder}: mouth picture {number} is {rgb.shape[1]}x{rgb.shape[0]}, box.json says "
                f"{crop.width}x{crop.height}"
            )
        yield flatten(rgb)


def flatten(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """RGB (h, w, 3) to its BT.709 planes, flattened (P,) and rounded."""
    flat = np.concatenate([plane.ravel() for plane in to_planes(rgb)])
    return cast(NDArray[np.uint8], np.clip(np.rint(flat), 0, 255).astype(np.uint8))


def read_picture(path: Path) -> NDArray[np.uint8]:
    """An RGB picture (H, W, 3)."""
    found = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if found is None:
        raise TrainingFailed(f"{path} is missing or no picture")
    return np.ascontiguousarray(found[..., ::-1]).astype(np.uint8)


def read_clip(path: Path) -> Iterator[NDArray[np.uint8]]:
    """The frames of a clip, RGB (H, W, 3)."""
    try:
        with av.open(str(path)) as container:
            for frame in container.decode(video=0):
                yield frame.to_ndarray(format="rgb24").astype(np.uint8, copy=False)
    except (OSError, IndexError, av.FFmpegError) as error:
        raise TrainingFailed(f"{path} cannot be decoded: {error}") from error


def _phones(path: Path) -> tuple[Phone, ...]:
    phones = tuple(Phone(str(symbol), float(start), float(end)) for symbol, start, end in read_json(path))
    check_phones(phones, str(path))
    return phones


def check_phones(phones: Sequence[Phone], where: str) -> None:
    """Raise `TrainingFailed` unless phones are known, in order and gapless."""
    if not phones:
        raise TrainingFailed(f"{where} holds no phones")
    for number, phone in enumerate(phones):
        if phone.symbol not in PHONES:
            raise TrainingFailed(f"{where}: phone {number} is {phone.symbol!r}, which is not ARPAbet without stress")
        if phone.end < phone.start or (number and abs(phone.start - phones[number - 1].end) > 1e-3):
            raise TrainingFailed(f"{where}: phone {number} ({phone.symbol}) does not start where the last one ends")


def read_json(path: Path) -> Any:
    """What a JSON file holds; `TrainingFailed` if it cannot be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise TrainingFailed(f"{path} cannot be read: {error.strerror}") from error
    except json.JSONDecodeError as error:
        raise TrainingFailed(f"{path} is no JSON: {error}") from error
