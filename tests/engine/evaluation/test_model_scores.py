from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tiny_pack import TINY, tiny_modes

from app.engine.evaluation.common_space import CommonSpace
from app.engine.evaluation.model_scores import Recorded, Yardstick, score_model, score_rows
from app.engine.evaluation.opening import LinearOpening, Lips
from app.engine.models.sound import Sound
from app.engine.modes import Modes, densify
from app.speech import Phone

MODES = tiny_modes()
PIXELS = TINY.width * TINY.height
COUNT = 3


@pytest.fixture(scope="module")
def by() -> Yardstick:
    random = np.random.default_rng(1)
    space = CommonSpace(
        np.ones(PIXELS, np.float32), np.full(PIXELS, 120, np.float32),
        random.standard_normal((COUNT, PIXELS)).astype(np.float32) / 20, np.array([3, 2, 1], np.float32),
    )  # fmt: skip
    return Yardstick(space, MODES, LinearOpening(np.array([0.3, 0, 0, 0, 0]), 0.5), 0.0)


@pytest.fixture(scope="module")
def said(by: Yardstick) -> list[Recorded]:
    """Two sentences that the modes draw exactly."""
    random = np.random.default_rng(2)
    found = []
    for number, frames in enumerate((25, 40)):
        rows = random.standard_normal((frames, MODES.count)).astype(np.float32)
        rows[11:15, 0] = -3  # closed in the M
        offset = random.standard_normal(MODES.count).astype(np.float32)
        counted = np.ones(frames, bool)
        counted[4] = False
        phones = (Phone("SIL", 0, 0.4), Phone("M", 0.4, 0.6), Phone("AA", 0.6, frames / 25))
        sound = Sound(np.zeros(100, np.float32), 16_000, start=number)
        common = by.space.of_mouths(rows + offset, MODES)
        found.append(Recorded(f"sentence {number}", phones, sound, counted, rows, offset, common))
    return found


def test_the_truth_is_without_error(said: list[Recorded], by: Yardstick) -> None:
    scores = score_rows([each.coefficients for each in said], said, by)
    assert scores.trajectory.error == pytest.approx(0, abs=1e-9)
    assert scores.trajectory.correlation == pytest.approx(1)
    assert scores.squares == pytest.approx(0, abs=1e-6)
    assert scores.opening is not None
    assert scores.opening.correlation == pytest.approx(1)


def test_scores_are_those_of_the_definitions(said: list[Recorded], by: Yardstick) -> None:
    random = np.random.default_rng(3)
    noise = [0.2 * random.standard_normal(each.coefficients.shape) for each in said]
    rows = [(0.5 * each.coefficients + more).astype(np.float32) for each, more in zip(said, noise, strict=True)]
    scores = score_rows(rows, said, by)
    errors, correlations, weighted, squares = [], [], [], []
    weight = [9 / 14, 4 / 14, 1 / 14]
    for row, each in zip(rows, said, strict=True):
        shown = by.space.of_mouths(row + each.offset, MODES)
        kept = [t for t in range(len(row)) if t != 4]
        error, related = [], []
        for component in range(COUNT):
            a = [float(shown[t, component]) for t in kept]
            b = [float(each.common[t, component]) for t in kept]
            error.append(sum((x - y) ** 2 for x, y in zip(a, b, strict=True)) / len(kept))
            mean_a, mean_b = sum(a) / len(a), sum(b) / len(b)
            product = sum((x - mean_a) * (y - mean_b) for x, y in zip(a, b, strict=True))
            related.append(product / math.sqrt(sum((x - mean_a) ** 2 for x in a) * sum((y - mean_b) ** 2 for y in b)))
        errors.append(sum(error) / COUNT)
        correlations.append(sum(related) / COUNT)
        weighted.append(sum(w * e for w, e in zip(weight, error, strict=True)))
        scale = by.space.scale
        squares += [sum(float(scale[c] * (shown[t, c] - each.common[t, c])) ** 2 for c in range(COUNT)) for t in kept]
    its = scores.trajectory
    assert its.error == pytest.approx(sum(errors) / 2, rel=1e-4)
    assert its.error_deviation == pytest.approx(abs(errors[0] - errors[1]) / 2, rel=1e-3)
    assert its.correlation == pytest.approx(sum(correlations) / 2, rel=1e-4)
    assert its.correlation_deviation == pytest.approx(abs(correlations[0] - correlations[1]) / 2, rel=1e-3)
    assert its.error_weighted == pytest.approx(sum(weighted) / 2, rel=1e-4)
    assert its.error_weighted_deviation == pytest.approx(abs(weighted[0] - weighted[1]) / 2, rel=1e-3)
    assert scores.squares == pytest.approx(sum(squares) / len(squares), rel=1e-4)


def test_lips_that_stay_open_are_counted_where_the_recorded_ones_close(said: list[Recorded], by: Yardstick) -> None:
    wide = [np.full_like(each.coefficients, 2.0) for each in said]
    scores = score_rows(wide, said, by)
    assert (scores.closings, scores.unclosed) == (2, 1.0)
    narrow = [np.full_like(each.coefficients, -2.0) for each in said]
    assert score_rows(narrow, said, by).unclosed == 0
    never = [replace(each, phones=each.phones[:1]) for each in said]
    scores = score_rows(wide, never, by)
    assert scores.closings == 0
    assert math.isnan(scores.unclosed)


def test_a_model_is_given_phones_frames_and_sound(said: list[Recorded], by: Yardstick) -> None:
    asked = []

    def predict(phones, frames, *, sound=None):  # type: ignore[no-untyped-def]
        asked.append((phones, frames, sound))
        return np.zeros((frames, MODES.count), np.float32)

    scores = score_model(predict, said, by)
    assert asked == [(each.phones, len(each.counted), each.sound) for each in said]
    assert scores.milliseconds > 0
    assert scores.trajectory.correlation == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("wrong", [np.zeros((25, 2), np.float32), np.full((25, 5), np.nan, np.float32)])
def test_what_is_no_trajectory_is_refused(said: list[Recorded], by: Yardstick, wrong: np.ndarray) -> None:
    with pytest.raises(ValueError, match="sentence 0"):
        score_rows([wrong], said[:1], by)


def test_the_opening_is_linear_in_the_coefficients() -> None:
    modes: Modes = MODES
    lips = Lips(4, 14, 8, 17, 2.0, 12.0)
    linear = LinearOpening.of_modes(lips, modes)
    rows = np.random.default_rng(0).standard_normal((6, modes.count)).astype(np.float32)
    expected = [lips.opening(densify(modes.flow(row), modes.width, modes.height)) for row in rows]
    np.testing.assert_allclose(linear.of(rows), expected, atol=1e-5)
    assert not linear.weights[modes.flow_count :].any()
