from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_recording import BROKEN, CROP, SIDE
from numpy.typing import NDArray

from app.engine.background import GRID, Background
from app.engine.metrics import gradient_energy
from app.engine.modes import draw_crop, split_texture
from app.engine.pack import MODEL, digest
from app.engine.selection import still_crop
from app.engine.selection_library import SampleLibrary, load_library
from app.engine.training.appearance import Appearance
from app.engine.training.articulation import rest_offset
from app.engine.training.corpus import Corpus, without
from app.engine.training.further_models import check_further
from app.engine.training.layout import importance, mouth_box
from app.engine.training.selection_samples import Seam, build_samples, choose_runs, lips_of, write_samples
from app.engine.training.take import speaking
from app.engine.warp import pixel_grid, sample
from app.errors import NotFound, TrainingFailed

Float = NDArray[np.float32]
SIZE = CROP.width * CROP.height


@pytest.fixture(scope="module")
def background(corpus: Corpus) -> Background:
    """A head that does not move."""
    grid = (2, -(-CROP.height // GRID) + 1, -(-CROP.width // GRID) + 1, 2)
    return Background(np.stack([corpus.layout.reference] * 2), CROP, CROP, np.zeros(grid, np.float32), corpus.mask)


@pytest.fixture(scope="module")
def library(corpus: Corpus, appearance: Appearance, background: Background) -> SampleLibrary:
    return build_samples(corpus, appearance.coefficients, appearance.modes, appearance.rest, background)


def frame_of(corpus: Corpus, appearance: Appearance) -> dict[bytes, int]:
    """Corpus frames by what their samples are known by."""
    found = {}
    for passage in corpus.passages:
        frames = np.arange(passage.frames.start, passage.frames.stop)
        offset = rest_offset(corpus, appearance.coefficients, appearance.rest, frames)
        found.update({(appearance.coefficients[n] - offset).astype(np.float32).tobytes(): int(n) for n in frames})
    return found


def test_samples_are_the_frames_in_which_somebody_speaks(
    corpus: Corpus, appearance: Appearance, library: SampleLibrary
) -> None:
    known = frame_of(corpus, appearance)
    numbers = np.array([known[row.tobytes()] for row in library.rows])
    assert (np.diff(numbers) > 0).all()
    assert corpus.good[numbers].all()
    spoken = np.concatenate([speaking(corpus.phones(p), len(p.frames)) for p in corpus.passages])
    assert set(np.flatnonzero(spoken & corpus.good)) <= set(numbers.tolist())
    starts = [passage.frames.start for passage in corpus.passages]
    for at, number in enumerate(numbers):
        assert library.follows[at] == (at > 0 and numbers[at - 1] == number - 1 and number not in starts)
    broken = corpus.passages[1].frames.start + BROKEN[1].stop
    assert not library.follows[numbers.tolist().index(broken)]


def test_a_sample_has_its_frames_own_pixels_and_meets_the_still_at_the_edge(
    corpus: Corpus, appearance: Appearance, library: SampleLibrary, background: Background
) -> None:
    known = frame_of(corpus, appearance)
    still = still_crop(background)
    outside = np.flatnonzero(corpus.mask.ravel() == 0)
    inner = mouth_box(CROP, SIDE)
    for at in range(5, len(library), 40):
        frame = corpus.frames.take([known[library.rows[at].tobytes()]])[0].astype(float)
        shown = library.pictures[at].astype(float)
        assert np.array_equal(shown[outside], still[outside])
        a, b = (each[:SIZE].reshape(CROP.height, CROP.width)[inner] for each in (frame, shown))
        assert np.abs(cv2.Laplacian(a - b, cv2.CV_64F)[1:-1, 1:-1]).max() <= 4.01  # rounding: nothing was resampled
        assert np.abs(a - b).mean() < 4


def test_fewer_samples_are_whole_runs_that_stand_for_all(
    corpus: Corpus, appearance: Appearance, library: SampleLibrary, background: Background
) -> None:
    few = build_samples(
        corpus, appearance.coefficients, appearance.modes, appearance.rest, background, most=len(library) // 2
    )
    assert len(library) / 4 < len(few) <= len(library) // 2
    assert {row.tobytes() for row in few.rows} < {row.tobytes() for row in library.rows}


def test_runs_are_chosen_by_what_they_bring() -> None:
    random = np.random.default_rng(0)
    places = [random.normal(centre, 0.1, (20, 2)).astype(np.float32) for centre in (0, 0, 5, 0, 10)]
    chosen = choose_runs(places, 60)
    assert len(chosen) == 3
    assert {2, 4} < set(chosen)
    assert choose_runs(places, 1000) == [0, 1, 2, 3, 4]
    assert len(choose_runs(places, 5)) == 1


def test_distances_of_lips_are_those_of_drawn_mouths(corpus: Corpus, appearance: Appearance) -> None:
    good = np.flatnonzero(corpus.good)
    rows = appearance.coefficients
    lips = lips_of(corpus, rows, good, appearance.modes)
    assert (rows[good] @ lips).var(0).sum() == pytest.approx(1, rel=1e-3)
    root = np.sqrt(importance(CROP, SIDE))
    random = np.random.default_rng(1)
    near, drawn = [], []
    for _ in range(60):
        a, b = (int(number) for number in random.choice(good, 2))
        near.append(np.linalg.norm((rows[a] - rows[b]) @ lips))
        drawn.append(
            np.linalg.norm(
                root * (draw_crop(appearance.modes, rows[a]).luma - draw_crop(appearance.modes, rows[b]).luma)
            )
        )
    assert np.corrcoef(near, drawn)[0, 1] > 0.8


def test_the_seam_is_moved_to_where_it_is_at_rest_and_the_lips_are_not_touched() -> None:
    random = np.random.default_rng(2)
    still = 120 + cv2.GaussianBlur(random.normal(0, 150, (CROP.height, CROP.width)).astype(np.float32), (0, 0), 2)
    lower = sample(still, pixel_grid(CROP.width, CROP.height) - np.array([0.5, 1.5], np.float32))
    flat = np.concatenate([lower.ravel(), np.full(SIZE // 2, 128, np.float32)])
    seam = Seam(still, SIDE)
    moved = split_texture(seam(flat), CROP.width, CROP.height)
    inner = mouth_box(CROP, SIDE)
    lips = tuple(slice(side.start + 5, side.stop - 5) for side in inner)
    np.testing.assert_array_equal(moved.luma[lips], lower[lips])
    ring = (np.linalg.norm(seam.flow(lower), axis=2) > 1.3) & (pixel_grid(CROP.width, CROP.height).min(2) > 6)
    ring &= pixel_grid(CROP.width, CROP.height)[..., 1] < CROP.height - 7
    ring &= pixel_grid(CROP.width, CROP.height)[..., 0] < CROP.width - 7
    assert ring.sum() > 200
    assert np.abs(moved.luma - still)[ring].mean() < 0.4 * np.abs(lower - still)[ring].mean()


def test_samples_are_written_into_the_pack_as_sharp_as_they_were(
    corpus: Corpus, appearance: Appearance, library: SampleLibrary, background: Background, tmp_path: Path
) -> None:
    (tmp_path / MODEL).write_bytes(b"a model")
    told: list[float] = []
    write_samples(
        tmp_path, corpus, appearance.coefficients, appearance.modes, appearance.rest, background, progress=told.append
    )
    path = tmp_path / "models" / "selection.npz"
    found = load_library(
        path, modes=digest(tmp_path / MODEL), count=appearance.modes.count, size=(CROP.width, CROP.height)
    )
    assert np.array_equal(found.rows, library.rows)
    assert told == sorted(told)
    window = (slice(*found.window[:2]), slice(*found.window[2:]))
    energy = [
        gradient_energy(each.pictures[:, :SIZE].reshape(-1, CROP.height, CROP.width), window)
        for each in (library, found)
    ]
    assert energy[1] == pytest.approx(energy[0], rel=0.05)
    assert path.stat().st_size < library.pictures.size / 4


def test_without_speech_there_are_no_samples(corpus: Corpus, appearance: Appearance, background: Background) -> None:
    silent = replace(without(corpus, range(len(corpus.passages))))
    with pytest.raises(TrainingFailed, match="nobody speaks"):
        build_samples(silent, appearance.coefficients, appearance.modes, appearance.rest, background)


def test_what_may_be_trained_besides() -> None:
    assert check_further(["selection", "phone-mean"]) == ["phone-mean"]
    with pytest.raises(NotFound, match="'oil'") as caught:
        check_further(["selection", "oil"])
    assert "selection" in caught.value.advice
