"""Something learnt from a film of nobody, without the learning: real dataclasses around drawn pictures and a tone.

Every clip is 1.2 s: silence, three phones, silence. A dark ellipse opens and closes on a textured face that moves by
whole pixels; its poses are known, not tracked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.background import GRID, Background, Box
from app.engine.mmm import MorphableModel
from app.engine.modes import MESH_STEP, Modes
from app.engine.pack import FPS, Consent, Manifest, Pack
from app.engine.training import articulation
from app.engine.training.appearance import Appearance
from app.engine.training.articulation import learn_articulation, spoken_passages
from app.engine.training.corpus import Corpus, Passage
from app.engine.training.face_detector import FaceBox
from app.engine.training.face_tracker import template_of
from app.engine.training.footage import shots
from app.engine.training.frame_store import FrameStore
from app.engine.training.layout import Layout
from app.engine.training.registration import UNCORRECTED
from app.engine.training.survey import cut
from app.engine.training.take import Refusal, Take, resting
from app.engine.training.train import Learnt
from app.speech import Phone

Float = NDArray[np.float32]

WIDTH, HEIGHT, FRAMES = 160, 128, 30
FACE = FaceBox(40, 14, 90)
CROP = Box(52, 66, 64, 48)
MOUTH = (84, 90)
RATE, TONE = 16_000, 400.0
SPOKEN = (("M", "AA", "P"), ("P", "AA", "M"), ("AA", "M", "EH"))


@dataclass(frozen=True)
class Drawn:
    """Something learnt, its pack, and how far the head is moved in every frame of a clip."""

    learnt: Learnt
    pack: Pack


def phones_of(number: int) -> tuple[Phone, ...]:
    symbols = ("SIL", *SPOKEN[number % 3], "SIL")
    ends = (0.4, 0.5, 0.62, 0.72, 1.2)
    return tuple(Phone(s, a, b) for s, a, b in zip(symbols, (0.0, *ends[:-1]), ends, strict=True))


def opening(number: int) -> NDArray[np.float64]:
    """(FRAMES,) how far the mouth is open."""
    times = (np.arange(FRAMES) + 0.5) / FPS
    wide = {"AA": 1.0, "EH": 0.6}
    phones = phones_of(number)
    shown = [next((wide.get(p.symbol, 0.0) for p in phones if t < p.end), 0.0) for t in times]
    return np.convolve(np.pad(shown, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid")


def shift(frame: int) -> tuple[int, int]:
    """By how much the face is moved: pixels to the right and down."""
    return round(3 * np.sin(frame / 4)), frame % 3


def picture(open_by: float, moved: tuple[int, int]) -> NDArray[np.uint8]:
    """RGB."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    x, y = x - moved[0], y - moved[1]
    skin = 150 + 18 * np.sin(x / 3.1) * np.cos(y / 2.7) + 12 * np.sin(x / 5 + y / 7)
    skin += 40 * np.exp(-((x - 85) ** 2 + (y - 66) ** 2) / 60)  # a nose
    down = (y - MOUTH[1]) / (1.5 + 7 * open_by)
    dark = np.clip((1 - ((x - MOUTH[0]) / 14) ** 2 - down**2) * 3, 0, 1)
    luma = skin * (1 - dark) + 40 * dark
    return np.clip(np.stack([luma + 20, luma, luma - 15], -1), 0, 255).astype(np.uint8)


def write_clip(path: Path, number: int, *, sound: bool = True) -> None:
    """One clip; its tone sounds while it speaks."""
    with av.open(str(path), "w", format="mp4") as output:
        video = output.add_stream("libx264", rate=FPS, options={"crf": "12", "preset": "veryfast"})
        video.width, video.height, video.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        audio = output.add_stream("aac", rate=RATE, layout="mono") if sound else None
        for at, open_by in enumerate(opening(number)):
            rgb = picture(float(open_by), shift(at))
            output.mux(video.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")))
        output.mux(video.encode(None))
        if audio is not None:
            times = np.arange(round(1.2 * RATE)) / RATE
            samples = np.where((times >= 0.4) & (times < 0.72), 0.5 * np.sin(2 * np.pi * TONE * times), 0)
            for start in range(0, len(samples), 1024):
                piece = np.ascontiguousarray(samples[None, start : start + 1024].astype(np.float32))
                frame = av.AudioFrame.from_ndarray(piece, format="fltp", layout="mono")
                frame.sample_rate, frame.pts = RATE, start
                output.mux(audio.encode(frame))
            output.mux(audio.encode(None))


def drawn(
    folder: Path, names: Sequence[str], *, refused: Sequence[Refusal] = (), given_loop: bool = False, sound: bool = True
) -> Drawn:
    """Clips of these names in a folder, and what would be learnt from them."""
    takes = []
    for number, name in enumerate(names):
        path = folder / f"{number}.mp4"
        write_clip(path, number, sound=sound)
        takes.append(Take(name, path, phones_of(number)))
    corpus = _corpus(folder, takes, refused)
    appearance = _appearance(corpus)
    spoken = spoken_passages(corpus, appearance.coefficients, appearance.rest)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(articulation, "FEW", 0)  # one part is left out, as of a long recording
        learnt = Learnt(corpus, appearance, learn_articulation(spoken, appearance.rest, seed=0))
    return Drawn(learnt, _pack(learnt, folder, given_loop))


def _corpus(folder: Path, takes: Sequence[Take], refused: Sequence[Refusal]) -> Corpus:
    starts = np.arange(len(takes) + 1) * FRAMES
    pose = [np.array([[1, 0, across], [0, 1, down]], np.float64) for across, down in map(shift, range(FRAMES))]
    poses = np.stack(pose * len(takes))
    size = CROP.width * CROP.height * 3 // 2
    frames = FrameStore.create(folder / "frames.rows", len(poses), (size,), np.uint8)
    reference, thumbs = None, []
    for take, start in zip(takes, starts, strict=False):
        for at, shot in enumerate(shots(take.video)):
            if reference is None:
                reference = shot.picture.copy()
            frames.write(int(start) + at, cut(shot.picture, poses[start + at], CROP)[None])
            thumbs.append(cv2.resize(shot.picture[:HEIGHT], (24, 24), interpolation=cv2.INTER_AREA))
    assert reference is not None
    layout = Layout(reference, template_of(reference[:HEIGHT], FACE), CROP, FACE.side)
    rest = np.concatenate([resting(take.phones, FRAMES) for take in takes])
    good = np.ones(len(poses), bool)
    for refusal in refused:
        if refusal.frame is not None:
            good[[take.name for take in takes].index(refusal.take) * FRAMES + refusal.frame] = False
    return Corpus(
        layout, tuple(takes), starts.astype(np.int64), poses, np.linspace(1, 4, len(poses)).astype(np.float32), good,
        rest,
        tuple(Passage(n, range(start, start + FRAMES), 0) for n, start in enumerate(starts[:-1].tolist())),
        (UNCORRECTED,) * len(takes), frames.take(np.flatnonzero(rest)).mean(0, dtype=np.float32), frames,
        np.stack(thumbs).astype(np.uint8), tuple(refused),
    )  # fmt: skip


def _appearance(corpus: Corpus) -> Appearance:
    """Three principal components of texture; a flow that is nowhere, and a mode of it that nothing uses."""
    everything = corpus.frames.read(0, len(corpus.frames)).astype(np.float32)
    mean = everything.mean(0)
    axes = np.linalg.svd(everything - mean, full_matrices=False)[2][:3].astype(np.float32)
    mesh = (CROP.height // MESH_STEP, CROP.width // MESH_STEP)
    bump = np.zeros((1, *mesh, 2), np.float32)
    bump[0, 8:16, 10:22, 1] = 0.5
    modes = Modes(
        CROP.width, CROP.height, np.zeros((*mesh, 2), np.float32), bump, mean, axes, np.ones(mesh, np.float32),
        np.zeros_like(mean),
    )  # fmt: skip
    coefficients = np.zeros((len(everything), 4), np.float32)
    coefficients[:, 1:] = (everything - mean) @ axes.T
    coefficients[:, 0] = np.random.default_rng(0).normal(0, 0.1, len(everything))
    coefficients[~corpus.good] = 0
    chosen = (3, 14, 17)
    flows = np.random.default_rng(1).normal(0, 1, (3, CROP.height, CROP.width, 2)).astype(np.float32)
    flows[1] = 0
    return Appearance(
        MorphableModel(CROP.width, CROP.height, everything[list(chosen)], flows, 1), modes, coefficients, chosen,
        coefficients[corpus.good & corpus.rest].mean(0),
    )  # fmt: skip


def _pack(learnt: Learnt, folder: Path, given_loop: bool) -> Pack:
    """A pack whose loop is the one joined from the clips, or another."""
    from app.engine.training.background_loop import crop_warp, pose_map
    from app.engine.training.stretches import choose_stretches, joined
    from app.engine.training.train import most_frames

    corpus = learnt.corpus
    stretches = choose_stretches(corpus, most=most_frames(corpus.layout))
    mixed = joined(stretches, corpus)
    region = Box(44, 56, 84, 64)
    numbers = [parts[0][0] for parts in mixed]
    poses = [pose_map(crop_warp(corpus.poses[number], CROP, UNCORRECTED), region, CROP) for number in numbers]
    if given_loop:
        poses = [pose + 2 for pose in poses]
    pictures = [next(iter(shots(corpus.takes[number // FRAMES].video))).picture.copy() for number in numbers]
    posed = np.stack([*poses, np.zeros_like(poses[0])])
    assert posed.shape[1:3] == (region.height // GRID + 1, region.width // GRID + 1)
    background = Background(np.stack([*pictures, corpus.layout.reference]), CROP, region, posed, corpus.mask)
    manifest = Manifest(
        format=1, id="nobody", title="Nobody & <i>Co</i>", fps=FPS, width=WIDTH, height=HEIGHT,
        loop_frames=len(pictures), voice="mock", licence="CC0-1.0", provenance="drawn by a test", files={},
        consent=Consent(subject="nobody", statement="an ellipse"),
    )  # fmt: skip
    appearance = learnt.appearance
    return Pack(folder, manifest, appearance.modes, appearance.morphable, learnt.articulation.model, background)
