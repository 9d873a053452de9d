"""A recording of nobody: an ellipse of a mouth that opens and closes with its phones, already found and cut out.

No detector would take it for a face, so the corpus is made as `gather` would, from poses that are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.background import Box
from app.engine.frame import Picture, from_rgb, planes
from app.engine.pack import FPS
from app.engine.training.corpus import Corpus, Passage
from app.engine.training.face_detector import FaceBox
from app.engine.training.face_tracker import FaceTemplate
from app.engine.training.frame_store import FrameStore
from app.engine.training.layout import Layout
from app.engine.training.registration import UNCORRECTED, Correction
from app.engine.training.survey import cut
from app.engine.training.take import Refusal, Take, passages, resting
from app.speech import SILENCE, Phone

WIDTH, HEIGHT = 112, 112
CROP = Box(24, 28, 64, 56)
SIDE = 88.0
MIDDLE = 56.0
OPENING = {"AA": 1.0, "EH": 0.6, "UW": 0.35, "S": 0.15, "M": 0.0, "P": 0.0, SILENCE: 0.05}
SENTENCES = (5, 4)
"""Of each take."""
LOWERED = (0.0, 0.9, -0.8, 0.4, 0.0, -0.6, 0.8, 0.0, -0.4)
"""Pixels by which the whole mouth hangs lower in each passage: what a tracker may leave over."""
LIT = 3
"""The passage in another light."""
LIGHT = Correction(np.eye(3)[:2], 1.1, -6.0, (3.0, -2.0))
BROKEN = {1: range(20, 23), 6: range(30, 32)}
"""Frames of some passages that show something else, and are known to."""


def spoken(seed: int, sentences: int) -> tuple[Phone, ...]:
    """Sentences between silences of 0.9 s."""
    random = np.random.default_rng(seed)
    symbols: list[tuple[str, float]] = [(SILENCE, 0.9)]
    for _ in range(sentences):
        for _ in range(6):
            symbols.append((str(random.choice(["M", "P", "S"])), float(random.uniform(0.08, 0.12))))
            symbols.append((str(random.choice(["AA", "EH", "UW"])), float(random.uniform(0.15, 0.22))))
        symbols.append((SILENCE, 0.9))
    edges = np.round(np.concatenate([[0], np.cumsum([length for _, length in symbols])]), 4)
    return tuple(
        Phone(symbol, float(start), float(end))
        for (symbol, _), start, end in zip(symbols, edges, edges[1:], strict=False)
    )


def openings(phones: Sequence[Phone]) -> NDArray[np.float64]:
    """How far the mouth is open in every frame, 0 to 1; the lips are 40 ms ahead of the sound."""
    fine = 8  # steps a frame
    times = np.arange(round(phones[-1].end * FPS) * fine) / (FPS * fine) + 0.04
    target = np.array([OPENING[next((p.symbol for p in phones if t < p.end), SILENCE)] for t in times])
    window = np.hanning(2 * fine + 1)
    smooth = np.convolve(np.pad(target, fine, mode="edge"), window / window.sum(), mode="valid")
    return smooth[::fine]


def sway(frames: int) -> NDArray[np.float64]:
    """(T, 2) where each picture's pixels are in the reference: a head that comes back every two seconds."""
    turn = 2 * np.pi * np.arange(frames) / (2 * FPS)
    return np.stack([1.5 * np.sin(turn), 0.8 * np.sin(2 * turn)], 1)


def picture(opening: float, shift: tuple[float, float] = (0.0, 0.0), lowered: float = 0.0) -> NDArray[np.uint8]:
    """The whole frame, RGB: skin with a soft pattern, lips, and the dark with a row of teeth between them."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    x, y = x + shift[0], y + shift[1]
    pattern = 10 * np.sin(x / 3.1) * np.cos(y / 2.7) + 6 * np.sin(x / 1.9 + y / 2.3)
    skin = np.stack([190 + pattern, 140 + pattern, 115 + pattern], -1)
    y = y - lowered
    across, down = (x - MIDDLE) / 18, (y - MIDDLE) / (3 + 9 * opening)
    lips = np.clip((1.0 - (across**2 + down**2)) * 4 + 0.5, 0, 1)[..., None]
    inner_down = (y - MIDDLE) / (0.4 + 9 * opening)
    inside = np.clip((0.8 - ((x - MIDDLE) / 16) ** 2 - inner_down**2) * 3 + 0.5, 0, 1)[..., None] * min(1, opening * 4)
    teeth = np.clip(2 - np.abs(y - MIDDLE + 6 * opening), 0, 1)[..., None]
    mouth = np.array([50, 15, 15]) * (1 - teeth) + np.array([225, 220, 205]) * teeth
    drawn = skin * (1 - lips) + np.array([170, 70, 75]) * lips
    drawn = drawn * (1 - inside) + mouth * inside
    return np.rint(np.clip(drawn, 0, 255)).astype(np.uint8)


def lit(shown: Picture, light: Correction) -> Picture:
    """A picture in the light of a passage."""
    changed = shown.copy()
    luma, blue, red = planes(changed)
    for plane, gain, bias in ((luma, light.gain, light.bias), (blue, 1, light.tint[0]), (red, 1, light.tint[1])):
        plane[...] = np.clip(np.rint(plane * gain + bias), 0, 255)
    return changed


def write_lossless(path: Path, pictures: Sequence[Picture]) -> None:
    """A video that is decoded to exactly these pictures."""
    with av.open(str(path), "w") as output:
        stream = output.add_stream("ffv1", rate=FPS)
        stream.height, stream.width, stream.pix_fmt = pictures[0].shape[0] * 2 // 3, pictures[0].shape[1], "yuv420p"
        stream.codec_context.colorspace, stream.codec_context.color_range = 1, 1
        for shown in pictures:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(shown), format="yuv420p")
            frame.colorspace, frame.color_range = 1, 1
            output.mux(stream.encode(frame))
        output.mux(stream.encode(None))


def drawn_corpus(folder: Path) -> Corpus:
    """The recording made ready: two takes, nine passages that rest and are lit differently, five broken frames."""
    folder.mkdir(parents=True)
    random = np.random.default_rng(0)
    takes, parts, poses, crops, thumbs, rest = [], [], [], [], [], []
    refused = []
    starts = [0]
    corrections = [LIGHT if number == LIT else UNCORRECTED for number in range(sum(SENTENCES))]
    for index, sentences in enumerate(SENTENCES):
        take = Take(f"take{index}", folder / f"take{index}.mkv", spoken(index, sentences))
        opened, shifts = openings(take.phones), sway(round(take.phones[-1].end * FPS))
        shown = []
        for span in passages(take.phones, len(opened)):
            number = len(parts)
            parts.append(Passage(index, range(starts[-1] + span.start, starts[-1] + span.stop), span.start))
            for at in span:
                shift = (float(shifts[at, 0]), float(shifts[at, 1]))
                clean = from_rgb(picture(float(opened[at]), shift, LOWERED[number]))
                noisy = clean + random.normal(0, 1, clean.shape)
                if at - span.start in BROKEN.get(number, ()):
                    noisy = random.uniform(0, 255, clean.shape)
                    refused.append(Refusal(take.name, at, "something else"))
                seen = lit(np.clip(np.rint(noisy), 0, 255).astype(np.uint8), corrections[number])
                pose = np.array([[1, 0, -shift[0]], [0, 1, -shift[1]]])
                shown.append(seen)
                poses.append(pose)
                crops.append(corrections[number].undo(cut(seen, pose, CROP), CROP.width * CROP.height))
                thumbs.append(cv2.resize(planes(seen)[0], (24, 24), interpolation=cv2.INTER_AREA))
        write_lossless(take.video, shown)
        rest.append(resting(take.phones, len(opened)))
        takes.append(take)
        starts.append(starts[-1] + len(opened))
    assert len(parts) == len(LOWERED)
    good, resting_frames = np.ones(starts[-1], bool), np.concatenate(rest)
    for number, frames in BROKEN.items():
        good[[parts[number].frames.start + at for at in frames]] = False
    flat = np.stack(crops)
    store = FrameStore.create(folder / "frames-drawn.rows", len(flat), flat.shape[1:], np.uint8)
    store.write(0, flat)
    reference = from_rgb(picture(OPENING[SILENCE]))
    template = FaceTemplate(planes(reference)[0].astype(np.float32), FaceBox(12.0, 0.0, SIDE), 1.0)
    return Corpus(
        layout=Layout(reference, template, CROP, SIDE), takes=tuple(takes), starts=np.array(starts, np.int64),
        poses=np.stack(poses), residual=np.zeros(starts[-1], np.float32), good=good, rest=resting_frames,
        passages=tuple(parts), corrections=tuple(corrections),
        common=flat[good & resting_frames].mean(0, dtype=np.float64).astype(np.float32), frames=store,
        thumbs=np.stack(thumbs), refused=tuple(refused),
    )  # fmt: skip
