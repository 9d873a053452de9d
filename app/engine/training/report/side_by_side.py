"""A film of sentences that nothing was learnt from: recorded on the left, the mouth drawn by the model on the right.

The right half is the same picture with the model's mouth over the recorded one, at the picture's own pose, in its
passage's light and with its noise, so that the mouth is all that differs. What it shows was predicted from the phones
by the trial model that did not see the sentence.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.video.reformatter import ColorRange, Colorspace
from numpy.typing import NDArray

from app.engine.background import Background, Planes
from app.engine.frame import Picture, empty, planes
from app.engine.modes import ModeMouth
from app.engine.pack import FPS
from app.engine.training.articulation import rest_offset
from app.engine.training.background_loop import crop_warp, noise_of, pose_map, region_of
from app.engine.training.corpus import Passage
from app.engine.training.footage import shots
from app.engine.training.registration import Correction
from app.engine.training.report.passage_sound import RATE, passage_sound
from app.engine.training.train import Learnt
from app.engine.training.write_clips import BT709
from app.speech import Word

Float = NDArray[np.float32]

SECONDS = 20.0
"""Of film at most."""
LEAST = 1.0
"""Seconds: no shorter piece of a sentence is shown."""
EARLY = 60.0
"""Seconds: passages that begin later in their file are only shown if there are no others; all before is decoded."""
WIDEST = 640
"""Pixels of each half."""
BAR = 0.09
"""Height of the captions, in heights of the picture."""
PAPER, INK, PALE = 24, 225, 130
"""Luma of the bar, of its labels, and of words and phones."""
LONGEST_WORD = 14
"""Letters of a word that are shown at most."""
PIECE = 1024
"""Samples in a packet of AAC."""


@dataclass(frozen=True)
class Scene:
    """A sentence to be shown.

    Attributes:
        passage: which.
        frames: how many of it, from its first.
        coefficients: (T, K) predicted, about the common mouth at rest.
    """

    passage: Passage
    frames: int
    coefficients: Float


def choose_scenes(learnt: Learnt, *, seconds: float = SECONDS) -> list[Scene]:
    """Sentences of the validation part, evenly spread, together no longer than `seconds`."""
    corpus, spoken = learnt.corpus, learnt.articulation
    held = [
        Scene(corpus.passages[number], len(predicted), predicted)
        for number, predicted in zip(spoken.validation, spoken.predicted, strict=True)
    ]
    early = [scene for scene in held if scene.passage.first < EARLY * FPS]
    held = early or sorted(held, key=lambda scene: scene.passage.first)[:1]
    if not held:
        return []
    whole = [scene for scene in held if corpus.good[_numbers(scene.passage, scene.frames)].all()] or held
    room = round(seconds * FPS)
    usual = float(np.mean([scene.frames for scene in whole]))
    count = min(len(whole), max(1, int(room / usual)))
    chosen: list[Scene] = []
    for place in np.linspace(0, len(whole) - 1, count).round().astype(int):
        scene = whole[place]
        frames = min(scene.frames, room)
        if chosen and frames < LEAST * FPS:
            break
        chosen.append(Scene(scene.passage, frames, scene.coefficients))
        room -= frames
    return chosen


def write_side_by_side(
    learnt: Learnt, scenes: list[Scene], path: Path, *, words: Mapping[str, Sequence[Word]] | None = None
) -> None:
    """Write the film: H.264 and AAC in an MP4 that starts before all of it is there.

    Args:
        learnt: whose sentences and model.
        scenes: see `choose_scenes`; at least one.
        path: the file.
        words: of takes, by their names, if they are known; seconds from the first picture.
    """
    stage = Stage.of(learnt.corpus.layout.size)
    with _Film(path, stage.size) as film:
        for scene in scenes:
            take = learnt.corpus.takes[scene.passage.take]
            film.sound(passage_sound(take.video, scene.passage.first / FPS, scene.frames / FPS))
            said = captions(learnt, scene, (words or {}).get(take.name, ()))
            for name, (recorded, drawn) in zip(said, redrawn(learnt, scene), strict=True):
                film.picture(stage.show(recorded, drawn, name))


def redrawn(learnt: Learnt, scene: Scene) -> Iterator[tuple[Picture, Picture]]:
    """Every recorded picture of a scene, and the same with the predicted mouth."""
    corpus, appearance = learnt.corpus, learnt.appearance
    passage = scene.passage
    correction = corpus.corrections[corpus.passages.index(passage)]
    numbers = _numbers(passage, scene.frames)
    offset = rest_offset(corpus, appearance.coefficients, appearance.rest, np.arange(*_ends(passage)))
    warps = [crop_warp(corpus.poses[number], corpus.crop, correction) for number in numbers]
    video = corpus.takes[passage.take].video
    painter: _Painter | None = None
    for at, shot in enumerate(islice(shots(video), passage.first, passage.first + scene.frames)):
        if painter is None:
            size = shot.picture.shape[1], shot.picture.shape[0] * 2 // 3
            region = region_of(warps, corpus.crop, size)
            poses = [pose_map(warp, region, corpus.crop) for warp in warps]
            blank = np.zeros((len(poses) + 1, 2, 2), np.uint8)
            posed = np.stack([*poses, np.zeros_like(poses[0])])
            background = Background(blank, corpus.crop, region, posed, corpus.mask)
            painter = _Painter(background, ModeMouth(appearance.modes, background), correction)
        number = numbers[at]
        seen = appearance.coefficients[number] if corpus.good[number] else None
        yield shot.picture, painter.paint(shot.picture, at, scene.coefficients[at] + offset, seen)


@dataclass(frozen=True)
class _Painter:
    """Puts mouths over recorded ones.

    Attributes:
        background: of the scene: its poses.
        mouth: draws on it.
        light: of the passage.
    """

    background: Background
    mouth: ModeMouth
    light: Correction

    def paint(self, picture: Picture, index: int, coefficients: Float, seen: Float | None) -> Picture:
        """The picture with the mouth of some coefficients (K,).

        Args:
            picture: as recorded.
            index: of its pose.
            coefficients: of the mouth to draw.
            seen: (K,) of the mouth in the picture, which tells the noise; None if it is not known.
        """
        region, out = self.background.region, picture.copy()
        luma, chroma = self.background.posed_mask(index)
        wanted = self._lit(coefficients, index)
        known = self._lit(seen, index) if seen is not None else None
        targets = (region.luma(out), *region.chroma(out))
        for place, (target, weight) in enumerate(zip(targets, (luma, chroma, chroma), strict=True)):
            drawn = wanted[place]
            if known is not None:
                drawn = drawn + noise_of(target.astype(np.float32) - known[place])
            target[...] = np.clip(np.rint(target + weight * (drawn - target)), 0, 255)
        return out

    def _lit(self, coefficients: Float, index: int) -> tuple[Float, Float, Float]:
        drawn = Planes.empty(self.background.region.width, self.background.region.height)
        self.mouth.draw(coefficients.astype(np.float32), index, drawn)
        luma: Float = drawn.luma * np.float32(self.light.gain) + np.float32(self.light.bias)
        blue, red = (np.float32(tint) for tint in self.light.tint)
        return luma, drawn.blue + blue, drawn.red + red


@dataclass(frozen=True)
class Stage:
    """Two pictures beside each other with a bar of captions under them.

    Attributes:
        width, height: of each picture as shown.
        bar: height of the captions.
    """

    width: int
    height: int
    bar: int

    @classmethod
    def of(cls, size: tuple[int, int]) -> Stage:
        """For pictures (width, height), made smaller if they are wider than `WIDEST`."""
        scale = min(1.0, WIDEST / size[0])
        width, height = (2 * round(side * scale / 2) for side in size)
        return cls(width, height, max(24, 2 * round(BAR * height / 2)))

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the film."""
        return 2 * self.width, self.height + self.bar

    def show(self, recorded: Picture, drawn: Picture, caption: str) -> Picture:
        """Both pictures and the captions."""
        width, height = self.size
        out = empty(width, height)
        for plane, blank in zip(planes(out), (PAPER, 128, 128), strict=True):
            plane[...] = blank
        for side, (picture, label) in enumerate(((recorded, "REAL"), (drawn, "SYNTHESISED"))):
            self._place(picture, side * self.width, out)
            self._write(planes(out)[0], side * self.width, label, caption)
        return out

    def _place(self, picture: Picture, left: int, out: Picture) -> None:
        """A picture in its half, as large as fits."""
        own_height, own_width = picture.shape[0] * 2 // 3, picture.shape[1]
        scale = min(self.width / own_width, self.height / own_height)
        width, height = 2 * round(own_width * scale / 2), 2 * round(own_height * scale / 2)
        x, y = left + (self.width - width) // 4 * 2, (self.height - height) // 4 * 2
        for number, (source, target) in enumerate(zip(planes(picture), planes(out), strict=True)):
            part = 1 if number == 0 else 2
            size = (width // part, height // part)
            fitted = source if size == source.shape[::-1] else cv2.resize(source, size, interpolation=cv2.INTER_AREA)
            target[y // part : y // part + size[1], x // part : x // part + size[0]] = fitted

    def _write(self, luma: NDArray[np.uint8], left: int, label: str, caption: str) -> None:
        scale, line = self.bar / 48, self.height + round(self.bar * 0.68)
        margin = self.bar // 3
        face = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(luma, label, (left + margin, line), face, scale, INK, 1, cv2.LINE_AA)
        (length, _), _ = cv2.getTextSize(caption, face, scale, 1)
        cv2.putText(luma, caption, (left + self.width - margin - length, line), face, scale, PALE, 1, cv2.LINE_AA)


class _Film:
    """An MP4 in the making; time goes on by one picture, or by one piece of sound, at a time."""

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        options = {"movflags": "+faststart", "fflags": "+bitexact"}
        self._output: Any = av.open(str(path), "w", format="mp4", options=options)
        codec = {"crf": "19", "preset": "fast", "profile": "high", "flags": "+bitexact"}
        self._video: Any = self._output.add_stream("libx264", rate=FPS, options=codec)
        self._video.width, self._video.height, self._video.pix_fmt = *size, "yuv420p"
        context = self._video.codec_context
        context.color_range, context.colorspace = ColorRange.MPEG, Colorspace.ITU709
        context.color_primaries = context.color_trc = BT709
        context.thread_count = 1
        self._audio: Any = self._output.add_stream("aac", rate=RATE, layout="mono", options={"flags": "+bitexact"})
        self._audio.bit_rate = 96_000
        self._pictures = self._samples = 0
        self._waiting = np.zeros(0, np.float32)

    def __enter__(self) -> _Film:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._say(len(self._waiting))
                self._output.mux(self._audio.encode(None))
                self._output.mux(self._video.encode(None))
        finally:
            self._output.close()

    def sound(self, samples: NDArray[np.float32]) -> None:
        """What is heard from the end of the sound so far on."""
        self._waiting = np.concatenate([self._waiting, samples])

    def picture(self, picture: Picture) -> None:
        """The next picture; with it goes the sound up to its end."""
        frame = av.VideoFrame.from_ndarray(picture, format="yuv420p")
        frame.pts, frame.time_base = self._pictures, Fraction(1, FPS)
        frame.color_range, frame.colorspace = ColorRange.MPEG, Colorspace.ITU709
        self._output.mux(self._video.encode(frame))
        self._pictures += 1
        due = self._pictures * RATE // FPS - self._samples
        self._say(due // PIECE * PIECE)

    def _say(self, count: int) -> None:
        said, self._waiting = self._waiting[:count], self._waiting[count:]
        for start in range(0, len(said), PIECE):
            piece = np.ascontiguousarray(said[None, start : start + PIECE])
            frame = av.AudioFrame.from_ndarray(piece, format="fltp", layout="mono")
            frame.sample_rate, frame.pts, frame.time_base = RATE, self._samples, Fraction(1, RATE)
            self._samples += piece.shape[1]
            self._output.mux(self._audio.encode(frame))


def _ends(passage: Passage) -> tuple[int, int]:
    return passage.frames.start, passage.frames.stop


def _numbers(passage: Passage, frames: int) -> list[int]:
    return list(passage.frames[:frames])


def captions(learnt: Learnt, scene: Scene, words: Sequence[Word] = ()) -> list[str]:
    """The phone that sounds at every picture of a scene, after the word if it is known.

    Args:
        learnt: whose phones.
        scene: of one of its passages.
        words: of the whole take, seconds from its first picture.
    """
    phones = learnt.corpus.phones(scene.passage)
    found = []
    for at in range(scene.frames):
        time = (at + 0.5) / FPS
        phone = next((phone.symbol for phone in phones if time < phone.end), phones[-1].symbol)
        spoken = (word.text for word in words if word.start <= scene.passage.first / FPS + time < word.end)
        found.append(" ".join([*(_plain(text) for text in spoken), phone]))
    return found


def _plain(text: str) -> str:
    """A word in the letters that captions can be written in."""
    letters = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return letters if len(letters) <= LONGEST_WORD else letters[: LONGEST_WORD - 2] + ".."
