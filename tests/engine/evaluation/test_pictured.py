from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.avatar import RENDERERS, Avatar
from app.engine.background import Background, Planes
from app.engine.evaluation.pictured import Drawer, Gallery, changes
from app.engine.modes import draw_crop
from app.engine.pack import load_pack
from app.errors import NotFound

Float = NDArray[np.float32]


@pytest.mark.parametrize("renderer", list(RENDERERS))
def test_every_renderer_draws_the_crop(sampled: Path, renderer: str) -> None:
    pack = load_pack(sampled)
    drawn = Drawer.of(pack, renderer).luma(np.zeros((3, 5), np.float32), np.zeros(5, np.float32))
    assert drawn.shape == (3, pack.modes.height, pack.modes.width)
    assert np.isfinite(drawn).all()


def test_the_fast_renderer_draws_what_analysis_compares(mary: Avatar, spoken: Float) -> None:
    pack, offset = mary.pack, np.full(mary.pack.modes.count, 0.3, np.float32)
    rows = spoken[20:40:6]
    drawn = Drawer.of(pack, "fast").luma(rows, offset)
    expected = np.stack([draw_crop(pack.modes, row + offset).luma for row in rows])
    inside = pack.background.mask > 0.5
    assert np.abs(drawn - np.clip(expected, 0, 255))[:, inside].max() < 0.5


def test_an_unknown_renderer_is_named_with_those_there_are(tiny: Path) -> None:
    with pytest.raises(NotFound, match="'oil'") as caught:
        Drawer.of(load_pack(tiny), "oil")
    assert "fast" in caught.value.advice


class Sampler:
    """Shows one of two grey pictures, whichever is nearer; the first coefficient says how grey."""

    def plan(self, rows: Float, before: Float | None) -> Float:
        assert before is None
        return np.where(rows > 0.5, np.float32(1), np.float32(0))

    def draw(self, coefficients: Float, index: int, out: Planes) -> None:
        assert index == 0
        assert set(coefficients.tolist()) <= {0.0, 1.0}
        out.luma[:] = 100 + 10 * coefficients[0]


def test_a_renderer_that_plans_is_given_rows_without_the_offset_and_moved_in_the_picture(tiny: Path) -> None:
    pack = load_pack(tiny)
    drawer = replace(Drawer.of(pack, "fast"), mouth=Sampler())
    assert drawer.plans
    rows = np.array([[0.2] * 5, [0.9] * 5], np.float32)
    offset = np.full(5, 0.7, np.float32)
    moved, common = (draw_crop(pack.modes, each).luma for each in (drawer.rest + offset, drawer.rest))
    shown = drawer.luma(rows, offset)
    np.testing.assert_allclose(shown[0], 100 + moved - common, atol=1e-4)
    np.testing.assert_allclose(shown[1], 110 + moved - common, atol=1e-4)


def test_figures_of_pictures_are_those_of_the_definitions() -> None:
    random = np.random.default_rng(0)
    window = (slice(2, 14), slice(2, 14))
    gallery = Gallery("fast", window)
    recorded = random.integers(0, 256, (6, 16, 16)).astype(np.uint8)
    shown = recorded + random.standard_normal(recorded.shape).astype(np.float32)
    speech = np.array([False, True, True, False, True, True])
    for spent in (0.6, 0.06):
        gallery.add(shown, recorded, speech, np.arange(6.0), spent)
    scores = gallery.scores()
    error = np.square(shown - recorded.astype(np.float64))[speech, 2:14, 2:14]
    ratios = [10 * np.log10(255**2 / each.mean()) for each in error]
    assert scores.pictures is not None
    assert scores.pictures.psnr == pytest.approx(np.mean(ratios))
    assert scores.pictures.pictures == 8
    assert scores.squares == pytest.approx(2.5)
    assert scores.milliseconds == pytest.approx((100 + 10) / 2)
    assert scores.sharpness == pytest.approx(1, abs=0.01)
    assert scores.jumps == pytest.approx(1, abs=0.01)


def test_changes_are_root_mean_squares() -> None:
    pictures = np.zeros((3, 4, 4), np.float32)
    pictures[1] = 3
    pictures[2, 0, 0] = 99  # outside
    np.testing.assert_allclose(changes(pictures, (slice(1, 4), slice(1, 4))), [3, 3])


def test_without_speech_there_are_no_pictures() -> None:
    gallery = Gallery("fast", (slice(0, 4), slice(0, 4)))
    gallery.add(np.zeros((1, 4, 4), np.float32), np.zeros((1, 4, 4), np.uint8), np.zeros(1, bool), np.ones(1), 0.1)
    scores = gallery.scores()
    assert scores.pictures is None
    assert np.isnan([scores.sharpness, scores.jumps]).all()


def test_the_background_of_a_drawer_has_no_loop(tiny: Path) -> None:
    still: Background = Drawer.of(load_pack(tiny), "fast").still
    assert still.frames == 0
