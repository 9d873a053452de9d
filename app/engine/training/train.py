"""From a recording to an avatar pack (Fu 2011, 3.1; the serving form after `app.engine.modes`)."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from app.engine.frame import to_rgb
from app.engine.mmm import MorphableModel
from app.engine.modes import ModeMouth, Modes
from app.engine.pack import (
    FILES,
    FORMAT,
    IDLE,
    LOOP,
    MANIFEST,
    MODEL,
    PREVIEW,
    Manifest,
    checksums,
    save_model,
    write_manifest,
)  # fmt: skip
from app.engine.threads import one_thread_a_call
from app.engine.training.bake_loop import bake
from app.engine.training.chained_flow import chained_flows
from app.engine.training.em_pca import em_pca
from app.engine.training.fit_modes import BLOCK, fit_modes, frame_planes
from app.engine.training.fit_trajectory import Options, fit_trajectory
from app.engine.training.prototypes import choose_prototypes, choose_reference
from app.engine.training.recording import Recording, read, read_json
from app.engine.training.write_clips import write_idle, write_loop
from app.engine.trajectory import GaussianTrajectory
from app.errors import TrainingFailed
from app.speech import SILENCE

Float = NDArray[np.float32]
Progress = Callable[[str, float], None]
"""Told the step's name and the share of it that is done."""

PROTOTYPES = 46
CLUSTER_SPACE = 20
"""PCA coefficients in which frames are clustered and compared."""


@dataclass(frozen=True)
class Trained:
    """Everything that training learns from a recording.

    Attributes:
        modes: the serving form, without detail.
        coefficients: (T, K) analysed mode coefficients of every frame; zero where nothing was learnt from it.
        morphable: prototypes and flows.
        trajectory: the trajectory model.
        rest: (K,) the mouth at rest.
        rest_frames: frame numbers that show it.
        learnt: frame numbers of everything learnt from.
    """

    modes: Modes
    coefficients: Float
    morphable: MorphableModel
    trajectory: GaussianTrajectory
    rest: Float
    rest_frames: NDArray[np.int64]
    learnt: NDArray[np.int64]


def silent_progress(step: str, share: float) -> None:
    """Tell nobody."""


def learn(
    recording: Recording,
    *,
    leave_out: Collection[int] = (),
    seed: int = 0,
    options: Options | None = None,
    progress: Progress = silent_progress,
) -> Trained:
    """Learn a recording's model.

    Args:
        recording: what to learn from.
        leave_out: sentences (by number) that nothing may be learnt from; their coefficients stay zero.
        seed: of everything random; the same seed gives the same model.
        options: of the trajectory model.
        progress: see `Progress`.

    Raises:
        TrainingFailed: nothing is left to learn from, or the mouth never rests.
    """
    one_thread_a_call()  # threads would add up in another order, and the same seed would choose other prototypes
    spans = [span for number, span in enumerate(recording.spans()) if number not in leave_out]
    if not spans:
        raise TrainingFailed("no sentence is left to learn from")
    chosen = np.concatenate([np.array(span) for span in spans])
    learnt = recording.frames[chosen]
    width, height = recording.crop.width, recording.crop.height
    size = width * height

    def luma(frame: int) -> Float:
        return frame_planes(learnt[frame], width, height).luma

    def blocks() -> Iterator[Float]:
        for start in range(0, len(learnt), BLOCK):
            yield learnt[start : start + BLOCK, :size].astype(np.float32)

    progress("components", 0)
    components = em_pca(blocks, CLUSTER_SPACE, seed=seed)
    space = components.project(blocks)
    rest_frames = _rest_frames(recording)
    at_rest = np.flatnonzero(np.isin(chosen, rest_frames))
    if not len(at_rest):
        raise TrainingFailed("the recording has no silence in which the mouth rests", advice="Record a second of it.")
    prototypes = choose_prototypes(space, PROTOTYPES, seed=seed)
    reference = choose_reference(space, prototypes, int(at_rest[0]))
    flows = chained_flows(luma, space, reference, progress=lambda share: progress("flow", share))
    morphable = MorphableModel(
        width, height, learnt[prototypes].astype(np.float32), flows[prototypes].astype(np.float32),
        prototypes.index(reference),
    )  # fmt: skip
    progress("modes", 0)
    modes, analysed = fit_modes(learnt, flows, width, height, rest=at_rest, seed=seed)
    rest = analysed[at_rest].mean(0)
    coefficients = np.zeros((len(recording.frames), modes.count), np.float32)
    coefficients[chosen] = analysed
    trajectory = fit_trajectory(
        coefficients, recording.phones, spans, rest, fps=recording.fps, options=options or Options(seed=seed),
        progress=lambda share: progress("trajectories", share),
    )  # fmt: skip
    return Trained(modes, coefficients, morphable, trajectory, rest, chosen[at_rest], chosen)


REST_MARGIN = 0.16
"""Seconds of silence that the mouth may need to come to rest, or to prepare for speech."""


def _rest_frames(recording: Recording) -> NDArray[np.int64]:
    """Frames far from speech: silence, but for a margin at the sides where speech is."""
    times = np.arange(len(recording.frames)) / recording.fps
    resting = np.zeros(len(times), bool)
    last = len(recording.phones) - 1
    for number, phone in enumerate(recording.phones):
        if phone.symbol == SILENCE:
            start = phone.start + (REST_MARGIN if number else -np.inf)
            end = phone.end - (REST_MARGIN if number < last else -np.inf)
            resting |= (times >= start) & (times <= end)
    return np.flatnonzero(resting).astype(np.int64)


def train(
    folder: Path,
    output: Path,
    *,
    identity: Path | None = None,
    leave_out: Collection[int] = (),
    seed: int = 0,
    progress: Progress = silent_progress,
) -> Manifest:
    """Train the avatar of a recording and write its pack.

    Args:
        folder: the recording.
        identity: JSON with id, title, voice, licence, provenance, consent; by default `avatar.json` in the folder.
        output: the pack's folder; its files are replaced when everything is done, and untouched if anything fails.
        leave_out: sentences (by number, from 0) that nothing may be learnt from: for open tests.
        seed: of everything random.
        progress: see `Progress`.

    Raises:
        TrainingFailed: the recording or its identity is incomplete or wrong.
    """
    source = identity or folder / "avatar.json"
    described = _identity(source)
    progress("reading", 0)
    recording = read(folder)
    _manifest(described, source, recording, 1, {})  # what is wrong with the identity is said before the work
    unknown = [number for number in leave_out if not 0 <= number < len(recording.sentences)]
    if unknown:
        raise TrainingFailed(f"there is no sentence {unknown[0]}; the recording has {len(recording.sentences)}")
    trained = learn(recording, leave_out=leave_out, seed=seed, progress=progress)
    recorded_rest = recording.frames[trained.rest_frames].mean(0, dtype=np.float64).astype(np.float32)
    modes, background = bake(
        recording,
        recording.frames[trained.learnt],
        trained.modes,
        trained.rest,
        recorded_rest,
        ModeMouth,
        lambda share: progress("background", share),
    )
    progress("writing", 0)
    output.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=f".{output.name}-", dir=output.parent))
    try:
        save_model(draft / MODEL, modes, trained.morphable, trained.trajectory, background)
        write_loop(draft / LOOP, background.pictures, recording.fps)
        write_idle(draft / IDLE, background.pictures[:-1], recording.fps)
        if not cv2.imwrite(
            str(draft / PREVIEW), to_rgb(background.pictures[0])[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92]
        ):
            raise TrainingFailed(f"{draft / PREVIEW} could not be written")
        manifest = _manifest(described, source, recording, background.frames, checksums(draft))
        write_manifest(draft, manifest)
        _replace(draft, output)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    progress("writing", 1)
    return manifest


def _identity(source: Path) -> dict[str, Any]:
    if not source.exists():
        raise TrainingFailed(
            f"{source} is missing: an avatar needs a name, a voice, and the consent of the person shown",
            advice="See docs/avatars.md for what to write into it.",
        )
    found = read_json(source)
    if not isinstance(found, dict):
        raise TrainingFailed(f"{source} must hold an object")
    return found


def _manifest(
    described: dict[str, Any], source: Path, recording: Recording, loop_frames: int, files: dict[str, str]
) -> Manifest:
    width, height = recording.size
    measured = {
        "format": FORMAT,
        "fps": recording.fps,
        "width": width,
        "height": height,
        "loop_frames": loop_frames,
        "files": files,
    }
    try:
        return Manifest.model_validate(described | measured)
    except ValidationError as error:
        first = error.errors()[0]
        raise TrainingFailed(f"{source}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error


def _replace(draft: Path, output: Path) -> None:
    """Move a finished pack to where it belongs, its manifest last; other files of the folder stay."""
    output.mkdir(exist_ok=True)
    for name in (*FILES, MANIFEST):
        (draft / name).replace(output / name)
