"""Which mouths of a recording become samples of the selection renderer, and what is made ready in them (Wang 2010)."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.background import Background, Box, chroma_map
from app.engine.membrane import Stitcher
from app.engine.modes import Modes, draw_crop, split_texture
from app.engine.pack import FPS, MODEL, MODELS, digest
from app.engine.selection import still_crop
from app.engine.selection_library import NAME, SampleLibrary, save_library
from app.engine.training.articulation import rest_offset
from app.engine.training.corpus import Corpus
from app.engine.training.em_pca import em_pca
from app.engine.training.landmark_flow import dense_flow
from app.engine.training.layout import face_mask, importance, mouth_box
from app.engine.training.take import speaking
from app.engine.training.write_clips import write_clip
from app.engine.warp import pixel_grid
from app.errors import TrainingFailed

Float = NDArray[np.float32]
Numbers = NDArray[np.int64]

MOST = 1500
"""Samples: the joining costs of all pairs lie in memory, and what a pack weighs grows with them."""
MARGIN = 3
"""Frames before and after speech that are samples too: a mouth that opens and that closes."""
EVERY = 4
"""Every so manyth mouth of the recording is asked how well the samples stand for it."""
EIGEN_LIPS = 60
"""Components, as many as in 4.1."""
DRAWN = 40
"""Mouths at which it is measured how eigen-lips change with the coefficients."""
STEP = 0.3
"""Deviations of a coefficient for that."""
CRF = "8"
"""Quality of the clip: what x264 loses then is less than the recording's noise."""
SEAM = 0.85
"""Where the skin begins that is moved to fit the seam, as a share of the radius up to which the mask is one."""
STEADY = 0.03
"""Standard deviation of the blur that the movement of that skin gets, in sides of the face box."""
MOST_MOVED = 0.06
"""And how far it is moved at most."""


def build_samples(
    corpus: Corpus, coefficients: Float, modes: Modes, rest: Float, background: Background, *, most: int = MOST,
    seed: int = 0, progress: Callable[[float], None] = lambda _: None,
) -> SampleLibrary:  # fmt: skip
    """The samples of a recording.

    Args:
        corpus: the recording; frames that are not good are left out.
        coefficients: (T, K) of its frames.
        modes: of the pack.
        rest: (K,) the mouth at rest.
        background: of the pack.
        most: samples.
        seed: of everything random.
        progress: told the share done.

    Raises:
        TrainingFailed: nobody speaks.
    """
    runs = [run for run in _runs(corpus) if len(run)]
    if not runs:
        raise TrainingFailed("nobody speaks in this recording: there are no samples to select from")
    rows = (coefficients - _offsets(corpus, coefficients, rest)).astype(np.float32)
    lips = lips_of(corpus, rows, np.concatenate(runs), modes, seed=seed)
    chosen = [runs[number] for number in choose_runs([rows[run] @ lips for run in runs], most)]
    numbers = np.concatenate([run[:most] for run in chosen])
    still = still_crop(background)
    stitcher = Stitcher(background.mask)
    deform = Seam(split_texture(still, modes.width, modes.height).luma, corpus.layout.side)
    pictures = np.empty((len(numbers), len(still)), np.uint8)
    for place, frame in enumerate(numbers):
        source = deform(corpus.frames.take([int(frame)])[0].astype(np.float32))
        pictures[place] = np.clip(np.rint(stitcher.stitched(source, still)), 0, 255)
        progress(place / len(numbers))
    kept = _unlike(rows[numbers])
    numbers, pictures = numbers[kept], pictures[kept]
    rowwise, across = mouth_box(corpus.crop, corpus.layout.side)
    follows = np.concatenate([[False], (np.diff(numbers) == 1) & _same_passage(corpus, numbers)])
    return SampleLibrary(
        modes.width, modes.height, pictures, rows[numbers], follows, lips,
        (rowwise.start, rowwise.stop, across.start, across.stop),
    )  # fmt: skip


def write_samples(
    draft: Path, corpus: Corpus, coefficients: Float, modes: Modes, rest: Float, background: Background, *,
    seed: int = 0, progress: Callable[[float], None] = lambda _: None,
) -> None:  # fmt: skip
    """Write the samples of a recording into the folder of a pack that has its `model.npz`; see `build_samples`."""
    library = build_samples(corpus, coefficients, modes, rest, background, seed=seed, progress=progress)
    path = draft / MODELS / f"{NAME}.npz"
    save_library(path, library, encoded(library), modes=digest(draft / MODEL))


def encoded(library: SampleLibrary) -> bytes:
    """The clip of a library's pictures."""
    pictures = library.pictures.reshape(len(library), library.height * 3 // 2, library.width)
    codec = {"crf": CRF, "preset": "slow", "x264-params": "deblock=-3,-3:aq-mode=0"}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "samples.mkv"
        write_clip(path, pictures, FPS, container="matroska", codec=codec)
        return path.read_bytes()


def _runs(corpus: Corpus) -> list[Numbers]:
    """For every passage its good frames in which somebody speaks, with those around."""
    found = []
    for passage in corpus.passages:
        frames = np.arange(passage.frames.start, passage.frames.stop)
        spoken = np.flatnonzero(speaking(corpus.phones(passage), len(frames)))
        if len(spoken):
            near = frames[max(0, spoken[0] - MARGIN) : spoken[-1] + 1 + MARGIN]
            found.append(near[corpus.good[near]])
    return found


def _offsets(corpus: Corpus, coefficients: Float, rest: Float) -> Float:
    """(T, K) how each frame's passage differs at rest from the common mouth at rest."""
    offsets = np.zeros_like(coefficients)
    for passage in corpus.passages:
        frames = np.arange(passage.frames.start, passage.frames.stop)
        offsets[frames] = rest_offset(corpus, coefficients, rest, frames)
    return offsets


def _same_passage(corpus: Corpus, numbers: Numbers) -> NDArray[np.bool_]:
    """(n - 1,) whether each number is of the same passage as the next."""
    ends = np.array([passage.frames.stop for passage in corpus.passages])
    return np.asarray(np.diff(np.searchsorted(ends, numbers, side="right")) == 0)


def _unlike(rows: Float) -> Numbers:
    """Numbers of rows that are like none before them."""
    return np.sort(np.unique(rows, axis=0, return_index=True)[1])


def lips_of(corpus: Corpus, rows: Float, frames: Numbers, modes: Modes, *, seed: int = 0) -> Float:
    """(K, K) what turns differences of coefficients into differences of eigen-lips, in units of their spread.

    Eigen-lips are principal components of the recorded mouths, luma weighted by importance. To draw a trajectory and
    project it would cost more than to draw the film, so their dependence on the coefficients is linearised: the mean
    over the recording of J J', J being the derivative (K, E), is a metric, and its root is what is returned.

    Args:
        corpus: whose pictures.
        rows: (T, K) coefficients, passages moved to one mouth at rest.
        frames: numbers of those that count.
        modes: of the pack.
        seed: of the choice of `DRAWN` mouths.
    """
    root = np.sqrt(importance(corpus.crop, corpus.layout.side)).ravel().astype(np.float32)
    asked = frames[:: max(1, len(frames) // MOST)]
    components = em_pca(
        lambda: (block[:, : len(root)].astype(np.float32) * root for block in corpus.frames.blocks(asked)),
        EIGEN_LIPS, seed=seed,
    )  # fmt: skip
    axes = components.axes * root
    step = STEP * np.maximum(rows[frames].std(0), 1e-3)
    random = np.random.default_rng(seed)
    metric = np.zeros((modes.count, modes.count))
    for frame in random.choice(frames, min(DRAWN, len(frames)), replace=False):
        around = rows[frame] + np.concatenate([np.zeros((1, modes.count)), np.diag(step)])
        drawn = np.stack([draw_crop(modes, row).luma.ravel() for row in around.astype(np.float32)]) @ axes.T
        slope = (drawn[1:] - drawn[:1]) / step[:, None]
        metric += slope.astype(np.float64) @ slope.T
    value, vector = np.linalg.eigh(metric)
    lips = vector * np.sqrt(np.maximum(value, 0))
    spread = np.sqrt((rows[frames] @ lips).var(0).sum())
    return np.asarray(lips / max(spread, 1e-12), np.float32)


def choose_runs(places: Sequence[Float], most: int) -> list[int]:
    """Numbers of runs that together come near to all, of at most so many frames (but one at least).

    Greedy: the next run is the one that brings most, for its length, to those that are still far from any chosen one.

    Args:
        places: (n, E) of each run's frames.
        most: frames in all.
    """
    asked = np.concatenate(places)[::EVERY]
    squares = (asked**2).sum(1)[:, None]
    reach = np.stack(
        [np.sqrt(np.maximum(squares - 2 * asked @ run.T + (run**2).sum(1), 0).min(1)) for run in places]
    )  # (runs, asked): distance of everything to each run
    near = np.full(len(asked), reach.max())
    left = dict.fromkeys(range(len(places)))
    chosen: list[int] = []
    room = most
    while left:
        best = max(left, key=lambda run: float((near - np.minimum(near, reach[run])).sum()) / len(places[run]))
        del left[best]
        if len(places[best]) > room and chosen:
            continue
        chosen.append(best)
        room -= len(places[best])
        near = np.minimum(near, reach[best])
        if room <= 0:
            break
    return sorted(chosen)


class Seam:
    """Moves the skin along the seam to where it is at rest: chin and jaw of an open mouth do not end at the mask.

    Inside, where lips and teeth are, nothing is moved and no pixel is touched.

    Args:
        still: (h, w) luma of the picture at rest.
        side: of the face box, pixels.
    """

    def __init__(self, still: Float, side: float) -> None:
        height, width = still.shape
        self._still, self._side = still, side
        self._moved = 1 - face_mask(Box(0, 0, width, height), SEAM * side)

    def flow(self, luma: Float) -> Float:
        """(h, w, 2) where each pixel of the result comes from, relative to itself.

        Args:
            luma: (h, w) of a sample.
        """
        flow = cv2.GaussianBlur(dense_flow(self._still, luma), (0, 0), STEADY * self._side)
        most = MOST_MOVED * self._side
        far = np.maximum(np.linalg.norm(flow, axis=2, keepdims=True) / most, 1)
        return np.asarray(self._moved[..., None] * flow / far, np.float32)

    def __call__(self, flat: Float) -> Float:
        """(P,) planes of a sample, its seam moved."""
        height, width = self._still.shape
        each = split_texture(flat, width, height)
        where = self.flow(each.luma) + pixel_grid(width, height)
        half = chroma_map(where)
        parts = zip(each.each(), (where, half, half), strict=True)
        return np.concatenate([_resampled(plane, points).reshape(-1) for plane, points in parts])


def _resampled(plane: Float, where: Float) -> Float:
    """A backward warp that blurs as little as can be; exact where nothing moves."""
    return cast(Float, cv2.remap(plane, where, None, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE))  # type: ignore[call-overload]
