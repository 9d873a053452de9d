from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tiny_pack import TINY, tiny_modes

from app.engine.evaluation.common_space import CommonSpace, learn_common_space
from app.engine.modes import draw_crop
from app.engine.training.frame_store import FrameStore
from app.engine.training.layout import importance

SIDE = 34.0
PIXELS = TINY.width * TINY.height
FRAMES, RANK = 60, 5


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Three passages whose mouths move in five directions; each has a look of its own, and one never rests."""
    random = np.random.default_rng(5)
    moves = random.standard_normal((RANK, PIXELS))
    amounts = random.standard_normal((FRAMES, RANK)) * [9, 7, 5, 3, 2]
    amounts += np.repeat(random.standard_normal((3, RANK)) * 8, 20, axis=0)
    luma = np.clip(np.rint(120 + amounts @ moves), 0, 255).astype(np.uint8)
    path: Path = tmp_path_factory.mktemp("frames") / "frames.rows"
    store = FrameStore.create(path, FRAMES, (PIXELS * 3 // 2,), np.uint8)
    store.write(0, np.concatenate([luma, np.full((FRAMES, PIXELS // 2), 128, np.uint8)], 1))
    good, rest = np.ones(FRAMES, bool), np.zeros(FRAMES, bool)
    good[7] = False
    rest[[0, 1, 2, 20, 21]] = True
    passages = tuple(SimpleNamespace(frames=range(start, start + 20)) for start in (0, 20, 40))
    return SimpleNamespace(
        crop=TINY, layout=SimpleNamespace(side=SIDE), good=good, rest=rest, frames=store, passages=passages, luma=luma
    )


def test_components_are_those_of_the_weighted_pixels(corpus: Any) -> None:
    space = learn_common_space(corpus, count=RANK)
    root = np.sqrt(importance(TINY, SIDE)).ravel()
    weighted = corpus.luma[corpus.good].astype(np.float64) * root
    mean = weighted.mean(0)
    _, _, axes = np.linalg.svd(weighted - mean, full_matrices=False)
    np.testing.assert_allclose(space.mean, mean, atol=1e-3)
    between = np.abs(space.axes.astype(np.float64) @ axes[:RANK].T)
    np.testing.assert_allclose(between, np.eye(RANK), atol=0.02)

    projected = (corpus.luma * root - mean) @ space.axes.T
    rests = [projected[:3].mean(0), projected[20:22].mean(0)]
    common = (rests[0] + rests[1]) / 2
    projected[:20] -= rests[0] - common
    projected[20:40] -= rests[1] - common
    np.testing.assert_allclose(space.scale, projected[corpus.good].std(0), rtol=1e-3)


def test_frames_and_their_luma_have_the_same_place(corpus: Any) -> None:
    space = learn_common_space(corpus, count=RANK)
    numbers = np.array([3, 59, 20])
    shown = space.of_frames(corpus.frames, numbers)
    assert shown.shape == (3, RANK)
    np.testing.assert_allclose(shown, space.of(corpus.luma[numbers]), rtol=1e-6)
    np.testing.assert_allclose(shown, space.of(corpus.luma[numbers].reshape(3, TINY.height, TINY.width)), rtol=1e-6)
    assert space.of_frames(corpus.frames, numbers[:0]).shape == (0, RANK)


def test_mouths_are_drawn_and_projected() -> None:
    random = np.random.default_rng(0)
    space = CommonSpace(
        np.ones(PIXELS, np.float32), np.zeros(PIXELS, np.float32), random.standard_normal((2, PIXELS)), np.ones(2)
    )
    modes = tiny_modes()
    rows = random.standard_normal((300, modes.count)).astype(np.float32)  # more than a block
    shown = space.of_mouths(rows, modes)
    assert shown.shape == (300, 2)
    for at in (0, 299):
        expected = space.axes @ draw_crop(modes, rows[at]).luma.ravel()
        np.testing.assert_allclose(shown[at], expected, rtol=1e-4)


def test_it_is_the_same_each_time(corpus: Any) -> None:
    first, again = (learn_common_space(corpus, count=RANK) for _ in range(2))
    assert np.array_equal(first.axes, again.axes)
    assert np.array_equal(first.scale, again.scale)


def test_pictures_that_move_in_few_ways_have_few_components(corpus: Any) -> None:
    luma = np.where(np.arange(FRAMES)[:, None] % 3 == 0, 100, 140) * np.ones((FRAMES, PIXELS))
    frames = FrameStore.create(corpus.frames.path.with_name("few.rows"), FRAMES, (PIXELS * 3 // 2,), np.uint8)
    frames.write(0, np.concatenate([luma, luma[:, : PIXELS // 2]], 1).astype(np.uint8))
    few = SimpleNamespace(**{**vars(corpus), "frames": frames})
    assert len(learn_common_space(few, count=20).axes) == 1
