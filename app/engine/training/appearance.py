"""The appearance of a talker: prototypes, flows, modes, and the coefficients of every frame (Fu 2011, 3.1)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from app.engine.mmm import MorphableModel
from app.engine.modes import MESH_STEP, Modes
from app.engine.training.corpus import Corpus, Progress
from app.engine.training.em_pca import Components, em_pca
from app.engine.training.fit_modes import Analysis, Weights, fit_flow, fit_texture, pulled_texture, skin_layer
from app.engine.training.frame_store import FrameStore
from app.engine.training.landmark_flow import Landmarks, chain, choose_landmarks
from app.engine.training.layout import importance
from app.engine.training.prototypes import choose_prototypes, choose_reference
from app.engine.training.take import speaking
from app.engine.training.workers import in_parallel
from app.engine.training.workspace import Workspace, key
from app.errors import TrainingFailed

Float = NDArray[np.float32]

PROTOTYPES = 46
LOOKS = 20
"""PCA coefficients in which frames are clustered and compared."""
LEAST_MOVING = 0.7
"""Luma levels by which the pixels of a mouth that speaks differ from their mean in its passage, at least."""
SILENT_SHARE = 0.08
"""Of the silent frames that are clustered with the speaking ones: else half of all prototypes are closed mouths."""
PIECE = 64
"""Frames that a process is given at once."""
SAMPLED = 6000
"""Frames that modes are learnt from at most, evenly spread; all are analysed."""


@dataclass(frozen=True)
class Looks:
    """Which frames look alike: principal components of masked luma.

    Attributes:
        components: of the crop's luma times the mask.
        mask: (h, w).
    """

    components: Components
    mask: Float

    def of(self, frames: NDArray[np.uint8]) -> Float:
        """(n, LOOKS) coefficients of frames (n, P)."""
        size = self.mask.size
        masked = frames[:, :size].astype(np.float32) * self.mask.ravel()
        return cast(Float, (masked - self.components.mean) @ self.components.axes.T)


@dataclass(frozen=True)
class Appearance:
    """What a mouth looks like, learnt.

    Attributes:
        morphable: prototypes and flows.
        modes: the serving form, without detail.
        coefficients: (T, K) of every frame; zero where `Corpus.good` is false.
        prototypes: frame numbers.
        rest: (K,) the mouth at rest.
    """

    morphable: MorphableModel
    modes: Modes
    coefficients: Float
    prototypes: tuple[int, ...]
    rest: Float


def learn_appearance(
    corpus: Corpus, workspace: Workspace, *, seed: int, progress: Progress, workers: int = 0
) -> Appearance:
    """Learn prototypes and modes of a corpus, and analyse all its frames.

    Args:
        corpus: frames that are not good are left out of everything.
        workspace: keeps what is finished.
        seed: of everything random; the same seed gives the same model.
        progress: see `Progress`.
        workers: processes; 0 for one a core.

    Raises:
        TrainingFailed: the mouth never rests.
    """
    width, height = corpus.crop.width, corpus.crop.height
    good = np.flatnonzero(corpus.good)
    at_rest = np.flatnonzero(corpus.good & corpus.rest)
    if not len(at_rest):
        raise TrainingFailed("the recording has no silence in which the mouth rests", advice="Record a second of it.")
    silent = ~_speaking(corpus)
    of_frames = key(corpus.frames.path.name, corpus.good, corpus.rest, silent, seed)
    looks, space = _looks(corpus, good, workspace, of_frames, seed, progress)
    if _moving(corpus, good, space, looks) < LEAST_MOVING:
        raise TrainingFailed(
            "the mouth does not move while it speaks", advice="Is it a film of the person, not a still picture?"
        )
    own = space - _rest_of_each(corpus, good, space)
    random = np.random.default_rng(seed)
    clustered = np.flatnonzero(~silent[good] | (random.random(len(good)) < SILENT_SHARE))
    prototypes = [int(clustered[place]) for place in choose_prototypes(own[clustered], PROTOTYPES, seed=seed)]
    reference = choose_reference(space, prototypes, int(np.searchsorted(good, at_rest[0])))
    landmarks = _landmarks(corpus, good, space, prototypes, reference, workspace, of_frames, progress)
    weights = Weights.of(importance(corpus.crop, corpus.layout.side))
    mesh = weights.flow.shape[:2]
    flows = workspace.store(
        "flows", of_frames, len(corpus.frames), (*mesh, 2), np.float16,
        lambda store: _each(
            partial(
                _write_flows, frames=corpus.frames, store=store, looks=looks, folder=workspace.folder, key=of_frames,
                size=(width, height),
            ),
            good, progress, "flow", workers,
        ),
    )  # fmt: skip
    sample = good[np.unique(np.linspace(0, len(good) - 1, min(SAMPLED, len(good))).astype(int))]
    stored = workspace.step(
        "modes", of_frames,
        lambda: _modes(corpus, flows, sample, at_rest, weights, workspace, of_frames, seed, progress, workers),
    )  # fmt: skip
    modes = Modes(
        width, height, stored["flow_mean"], stored["flow_modes"], stored["texture_mean"], stored["texture_modes"],
        stored["layer"], np.zeros_like(stored["texture_mean"]),
    )  # fmt: skip
    coefficients = workspace.step(
        "coefficients", of_frames,
        lambda: {"all": _analysed(corpus, flows, modes, weights, good, progress, workers)},
    )["all"]  # fmt: skip
    chosen = [int(good[place]) for place in prototypes]
    places = np.searchsorted(landmarks.numbers, chosen)
    morphable = MorphableModel(
        width, height, corpus.frames.take(chosen).astype(np.float32),
        landmarks.known.flows[places].astype(np.float32), prototypes.index(reference),
    )  # fmt: skip
    rest = coefficients[at_rest].mean(0)
    return Appearance(morphable, modes, coefficients, tuple(chosen), rest)


def _speaking(corpus: Corpus) -> NDArray[np.bool_]:
    counts = np.diff(corpus.starts)
    return np.concatenate([speaking(take.phones, int(n)) for take, n in zip(corpus.takes, counts, strict=True)])


def _looks(
    corpus: Corpus, good: NDArray[np.int64], workspace: Workspace, of_frames: str, seed: int, progress: Progress
) -> tuple[Looks, Float]:
    mask = corpus.mask
    size = mask.size

    def blocks() -> Iterator[Float]:
        for block in corpus.frames.blocks(good):
            yield block[:, :size].astype(np.float32) * mask.ravel()

    def compute() -> dict[str, NDArray[Any]]:
        progress("components", 0)
        found = em_pca(blocks, LOOKS, seed=seed)
        return {
            "mean": found.mean, "axes": found.axes, "variance": found.variance, "space": found.project(blocks),
        }  # fmt: skip

    stored = workspace.step("looks", of_frames, compute)
    return Looks(Components(stored["mean"], stored["axes"], stored["variance"]), mask), stored["space"]


def _moving(corpus: Corpus, good: NDArray[np.int64], space: Float, looks: Looks) -> float:
    """Luma levels by which pixels of the mouth differ from their mean within a passage, root mean square."""
    squares = 0.0
    for passage in corpus.passages:
        inside = space[(good >= passage.frames.start) & (good < passage.frames.stop)]
        squares += float(np.square(inside - inside.mean(0)).sum()) if len(inside) else 0.0
    return float(np.sqrt(squares / len(good) / np.square(looks.mask).sum()))


def _rest_of_each(corpus: Corpus, good: NDArray[np.int64], space: Float) -> Float:
    """(n, LOOKS) for each good frame, how its passage at rest looks: subtracted, sessions and days do not count."""
    offset = np.zeros_like(space)
    overall = space[corpus.rest[good]].mean(0)
    for passage in corpus.passages:
        inside = np.flatnonzero((good >= passage.frames.start) & (good < passage.frames.stop))
        resting = inside[corpus.rest[good[inside]]]
        offset[inside] = (space[resting].mean(0) if len(resting) else overall) - overall
    return offset


@dataclass(frozen=True)
class _Numbered:
    """Landmarks and their frame numbers."""

    numbers: NDArray[np.int64]
    known: Landmarks


def _landmarks(
    corpus: Corpus, good: NDArray[np.int64], space: Float, prototypes: list[int], reference: int,
    workspace: Workspace, of_frames: str, progress: Progress,
) -> _Numbered:  # fmt: skip
    width, height = corpus.crop.width, corpus.crop.height

    def compute() -> dict[str, NDArray[Any]]:
        places = choose_landmarks(space, [reference, *prototypes])
        luma = corpus.frames.take(good[places])[:, : width * height].reshape(-1, height, width)
        at = int(np.flatnonzero(places == reference)[0])
        found = chain(
            luma.astype(np.float32), space[places], at, progress=lambda share: progress("landmarks", share)
        )  # fmt: skip
        return {"numbers": good[places], "luma": luma, "space": found.space, "flows": found.flows, "at": np.array(at)}

    stored = workspace.step("landmarks", of_frames, compute)
    return _Numbered(stored["numbers"], _read_landmarks(stored))


def _read_landmarks(stored: dict[str, NDArray[Any]]) -> Landmarks:
    return Landmarks(stored["luma"].astype(np.float32), stored["space"], stored["flows"], int(stored["at"]))


def _pieces(numbers: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    return [numbers[start : start + PIECE] for start in range(0, len(numbers), PIECE)]


def _each(
    work: Callable[[NDArray[np.int64]], None], numbers: NDArray[np.int64], progress: Progress, name: str, workers: int
) -> None:
    """Work on frames in pieces, in parallel."""
    for _ in in_parallel(work, _pieces(numbers), workers=workers, progress=lambda share: progress(name, share)):
        pass


@lru_cache(maxsize=1)
def _stored_landmarks(folder: Path, of_frames: str) -> Landmarks:
    stored = Workspace(folder).kept("landmarks", of_frames)
    assert stored is not None
    return _read_landmarks(stored)


def _write_flows(
    numbers: NDArray[np.int64], frames: FrameStore, store: FrameStore, looks: Looks, folder: Path, key: str,
    size: tuple[int, int],
) -> None:  # fmt: skip
    """Flows of some frames, on mesh vertices, into the store."""
    landmarks = _stored_landmarks(folder, key)
    width, height = size
    flat = frames.take(numbers)
    for number, frame, look in zip(numbers, flat, looks.of(flat), strict=True):
        luma = frame[: width * height].reshape(height, width).astype(np.float32)
        flow = landmarks.flow_to(luma, look)
        store.write(int(number), flow[None, ::MESH_STEP, ::MESH_STEP])


def _modes(
    corpus: Corpus, flows: FrameStore, sample: NDArray[np.int64], at_rest: NDArray[np.int64], weights: Weights,
    workspace: Workspace, of_frames: str, seed: int, progress: Progress, workers: int,
) -> dict[str, NDArray[Any]]:  # fmt: skip
    progress("modes", 0)
    flow_mean, flow_modes = fit_flow(lambda: flows.blocks(sample), weights, seed=seed)
    pixels = len(weights.texture)
    blank = np.zeros(pixels, np.float32)
    modes = Modes(
        corpus.crop.width, corpus.crop.height, flow_mean, flow_modes, blank, np.zeros((0, pixels), np.float32),
        np.ones(flow_mean.shape[:2], np.float32), blank,
    )  # fmt: skip

    def fill(store: FrameStore) -> None:
        work = partial(
            _write_textures, sample=sample, frames=corpus.frames, flows=flows, modes=modes, weights=weights, store=store
        )
        _each(work, np.arange(len(sample)), progress, "textures", workers)

    textures = workspace.store("textures", of_frames, len(sample), (pixels,), np.uint8, fill)
    progress("modes", 0.5)
    texture_mean, texture_modes = fit_texture(lambda: textures.blocks(np.arange(len(sample))), weights, seed=seed)
    analysis = Analysis(modes, weights)
    rest = np.mean([analysis.flow(vertices.astype(np.float32)) for vertices in flows.take(list(at_rest[:500]))], 0)
    at_rest_flow = np.tensordot(rest, flow_modes, 1) + flow_mean
    return {
        "flow_mean": flow_mean, "flow_modes": flow_modes, "texture_mean": texture_mean, "texture_modes": texture_modes,
        "layer": skin_layer(at_rest_flow),
    }  # fmt: skip


def _write_textures(
    places: NDArray[np.int64], sample: NDArray[np.int64], frames: FrameStore, flows: FrameStore, modes: Modes,
    weights: Weights, store: FrameStore,
) -> None:  # fmt: skip
    analysis = Analysis(modes, weights)
    rows = [
        pulled_texture(modes, frame, analysis.flow(vertices.astype(np.float32)))
        for frame, vertices in zip(frames.take(sample[places]), flows.take(sample[places]), strict=True)
    ]
    store.write(int(places[0]), np.clip(np.rint(np.stack(rows)), 0, 255).astype(np.uint8))


def _analysed(
    corpus: Corpus, flows: FrameStore, modes: Modes, weights: Weights, good: NDArray[np.int64], progress: Progress,
    workers: int,
) -> Float:  # fmt: skip
    coefficients = np.zeros((len(corpus.frames), modes.count), np.float32)
    pieces = _pieces(good)
    work = partial(_analyse_some, frames=corpus.frames, flows=flows, modes=modes, weights=weights)
    found = in_parallel(work, pieces, workers=workers, progress=lambda share: progress("analysis", share))
    for piece, rows in zip(pieces, found, strict=True):
        coefficients[piece] = rows
    return coefficients


def _analyse_some(
    numbers: NDArray[np.int64], frames: FrameStore, flows: FrameStore, modes: Modes, weights: Weights
) -> Float:
    analysis = Analysis(modes, weights)
    each = zip(frames.take(numbers), flows.take(numbers), strict=True)
    return np.stack([analysis(frame, vertices.astype(np.float32)) for frame, vertices in each])
