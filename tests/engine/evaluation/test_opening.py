from __future__ import annotations

import numpy as np
import pytest

from app.engine.evaluation.opening import CLOSED, HALF_WIDTH, Lips, closed, closings
from app.engine.mmm import MorphableModel
from app.speech import Phone

WIDTH, HEIGHT = 40, 32
WINDOW = (slice(8, 26), slice(8, 32))
UPPER, LOWER = 12, 20
"""Rows between which these mouths open."""


def flow(opening: float) -> np.ndarray:
    """Everything from row `LOWER` on moves down, everything up to row `UPPER` up; out of the window even further."""
    rows = np.interp(np.arange(HEIGHT), [UPPER, LOWER], [-0.25 * opening, 0.75 * opening])
    rows[-4:] = 3 * opening
    moved = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    moved[..., 1] = rows[:, None]
    return moved


@pytest.fixture
def model() -> MorphableModel:
    flows = np.stack([flow(opening) for opening in (-4.0, 0.0, 6.0)])
    return MorphableModel(WIDTH, HEIGHT, np.zeros((3, WIDTH * HEIGHT * 3 // 2), np.float32), flows, 1)


def test_lips_are_found_where_distances_change_most_inside_the_window(model: MorphableModel) -> None:
    lips = Lips.of(model, WINDOW)
    assert (lips.upper, lips.lower) == (8, LOWER) or (lips.upper, lips.lower) == (UPPER, LOWER)
    assert lips.right - lips.left == 2 * HALF_WIDTH + 1


@pytest.mark.parametrize("opening", [-4.0, -1.5, 0.0, 3.0, 6.0, 9.0])
def test_the_opening_is_measured_against_the_prototypes(model: MorphableModel, opening: float) -> None:
    assert Lips.of(model, WINDOW).opening(flow(opening)) == pytest.approx((opening + 4) / 10, abs=1e-5)


def test_a_shift_of_the_whole_mouth_is_no_opening(model: MorphableModel) -> None:
    lips = Lips.of(model, WINDOW)
    assert lips.opening(flow(2) + np.float32([1.5, -2])) == pytest.approx(lips.opening(flow(2)), abs=1e-5)


def test_closings_are_long_phones_that_close_the_lips() -> None:
    phones = (
        Phone("SIL", 0, 0.4), Phone("M", 0.4, 0.5), Phone("AA", 0.5, 0.7), Phone("B", 0.7, 0.74), Phone("P", 0.8, 1.0),
    )  # fmt: skip
    assert list(closings(phones, 25, 0.04)) == [slice(9, 13), slice(19, 25)]


def test_lips_close_if_any_picture_of_the_phone_shows_them_closed() -> None:
    opening = np.array([1, 0.9, CLOSED - 0.01, 0.8, CLOSED + 0.01, 1.0])
    assert closed(opening, [slice(0, 4), slice(3, 6)]) == [True, False]
