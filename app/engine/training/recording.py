"""A recording with the head at rest: mouth pictures, sound, phone times, and the material of the idle loop.

The folder holds

    recording/mouth.mkv or mouth/%05d.png    the mouth region of every frame, head pose fixed
    recording/box.json                       where it sits in the frame: x, y, w, h, fps, frame
    recording/still.png                      the whole frame at rest
    recording/phones.json                    [ARPAbet, start s, end s] lists
    recording/transcript.json                sentences with start and end
    recording/audio.wav                      mono
    idle/frames.mkv, idle/warp.npz           the loop, and its dense map from the still

Other files (the renderer's face controls, eye pictures) are not read: the loop brings its own blinks.
"""

from __future__ import annotations

import itertools
import json
import zipfile
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
from app.engine.pack import FPS
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
        path = self.folder / "recording" / "still.png"
        return self._whole(read_picture(path), path)

    def loop(self) -> Iterator[NDArray[np.uint8]]:
        """The frames of the idle loop, RGB."""
        path = self.folder / "idle" / "frames.mkv"
        return (self._whole(rgb, path) for rgb in read_clip(path))

    def _whole(self, rgb: NDArray[np.uint8], path: Path) -> NDArray[np.uint8]:
        if rgb.shape[1::-1] != self.size:
            found, wanted = (f"{width}x{height}" for width, height in (rgb.shape[1::-1], self.size))
            raise TrainingFailed(f"{path} is {found}, box.json says {wanted}")
        return rgb

    def loop_map(self) -> tuple[NDArray[np.float32], int]:
        """(L, rows, columns, 2) displacement from the loop's pixels to the still's, sampled every `step` pixels."""
        path = self.folder / "idle" / "warp.npz"
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                warp, step = stored["warp"].astype(np.float32), int(stored["step"])
            if warp.ndim != 4 or warp.shape[3] != 2 or step < 1:
                raise ValueError(f"warp has shape {warp.shape}, step is {step}")
            return warp, step
        except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile) as error:
            raise TrainingFailed(f"{path} is no pose map: {error}") from error


def read(folder: Path) -> Recording:
    """Read a recording.

    Raises:
        TrainingFailed: something is missing, unreadable or does not fit; says what and where.
    """
    crop, fps, size = _box(folder / "recording" / "box.json")
    phones = _phones(folder / "recording" / "phones.json")
    sentences = _sentences(folder / "recording" / "transcript.json")
    pictures = list(_mouth_frames(folder, crop))
    if not pictures:
        raise TrainingFailed(f"{folder}/recording has no mouth pictures")
    frames = np.stack(pictures)
    missing = len(frames) / fps - phones[-1].end
    if abs(missing) > 0.5:
        raise TrainingFailed(
            f"{folder}: {len(frames)} frames last {len(frames) / fps:.2f} s, the phones {phones[-1].end:.2f} s",
            advice="Frames and phones must be of the same recording.",
        )
    return Recording(folder, crop, fps, size, frames, phones, sentences)


def _box(path: Path) -> tuple[Box, float, tuple[int, int]]:
    """The mouth region, the frame rate, and the size of the whole frame."""
    box = read_json(path)
    try:
        crop = Box(int(box["x"]), int(box["y"]), int(box["w"]), int(box["h"]))
        fps, (width, height) = float(box["fps"]), (int(side) for side in box["frame"])
    except (KeyError, TypeError, ValueError) as error:
        raise TrainingFailed(f"{path}: needs x, y, w, h, fps and frame, two numbers, got {box}") from error
    if any(side % 2 for side in (crop.x, crop.y, crop.width, crop.height, width, height)):
        raise TrainingFailed(f"{path}: 4:2:0 needs even numbers, got {box}")
    across, down = 0 <= crop.x < crop.x + crop.width <= width, 0 <= crop.y < crop.y + crop.height <= height
    if not (across and down):
        raise TrainingFailed(f"{path}: the mouth is not inside the frame: {box}")
    if fps != FPS:
        raise TrainingFailed(f"{path}: {fps:g} frames a second", advice=f"Convert the recording to {FPS} first.")
    return crop, fps, (width, height)


def _sentences(path: Path) -> tuple[Sentence, ...]:
    try:
        return tuple(Sentence(entry["text"], float(entry["start"]), float(entry["end"])) for entry in read_json(path))
    except (KeyError, TypeError, ValueError) as error:
        raise TrainingFailed(f"{path}: needs a list of text, start and end") from error


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
    try:
        phones = tuple(Phone(str(symbol), float(start), float(end)) for symbol, start, end in read_json(path))
    except (TypeError, ValueError) as error:
        raise TrainingFailed(f"{path}: needs a list of [phone, start, end]") from error
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
    except ValueError as error:
        raise TrainingFailed(f"{path} is no JSON: {error}") from error
