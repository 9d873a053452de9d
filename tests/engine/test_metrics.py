from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.engine.metrics import (
    MOST_LAG,
    NO_ERROR,
    PEAK,
    correlation,
    gradient_energy,
    opening_scores,
    picture_scores,
    psnr,
    ssim,
    trajectory_scores,
)  # fmt: skip

WINDOW = (slice(2, 14), slice(3, 19))
seeds = st.integers(0, 2**32 - 1)


def trajectories(seed: int, sentences: int = 3, components: int = 4) -> tuple[list[np.ndarray], list[np.ndarray]]:
    random = np.random.default_rng(seed)
    lengths = random.integers(5, 40, sentences)
    true = [random.standard_normal((length, components)).cumsum(0) for length in lengths]
    return [each + random.standard_normal(each.shape) for each in true], true


@given(seeds)
def test_trajectory_scores_are_what_plain_loops_give(seed: int) -> None:
    predicted, true = trajectories(seed)
    scale = np.random.default_rng(seed).uniform(0.5, 3, 4)
    errors, related = [], []
    for shown, wanted in zip(predicted, true, strict=True):
        errors.append([np.mean(((shown[:, k] - wanted[:, k]) / scale[k]) ** 2) for k in range(4)])
        related.append([np.corrcoef(shown[:, k], wanted[:, k])[0, 1] for k in range(4)])
    scores = trajectory_scores(predicted, true, scale)
    assert scores.error == pytest.approx(np.mean(errors))
    assert scores.error_deviation == pytest.approx(np.std(np.mean(errors, 1)))
    assert scores.correlation == pytest.approx(np.mean(related))
    assert scores.correlation_deviation == pytest.approx(np.std(np.mean(related, 1)))
    assert scores.error_weighted == pytest.approx(np.average(np.mean(errors, 0), weights=scale**2))
    assert scores.correlation_weighted == pytest.approx(np.average(np.mean(related, 0), weights=scale**2))
    assert scores.sentences == 3
    assert scores.frames == sum(map(len, true))


@given(seeds, st.floats(0.1, 5))
def test_larger_motion_is_a_larger_amplitude_and_jerk(seed: int, gain: float) -> None:
    _, true = trajectories(seed)
    scores = trajectory_scores([gain * each for each in true], true, np.array([1.0, 2.0, 0.5, 1.0]))
    assert scores.amplitude == pytest.approx(gain)
    assert scores.jerk == pytest.approx(gain)
    assert scores.correlation == pytest.approx(1)


@given(seeds)
def test_units_do_not_count(seed: int) -> None:
    predicted, true = trajectories(seed)
    units = np.array([10.0, 0.1, 3.0, 7.0])
    one = trajectory_scores(predicted, true, np.ones(4))
    other = trajectory_scores([each * units for each in predicted], [each * units for each in true], units)
    assert one.error == pytest.approx(other.error)
    assert one.correlation == pytest.approx(other.correlation)


def test_a_mouth_that_does_not_move_correlates_with_nothing() -> None:
    _, true = trajectories(1)
    scores = trajectory_scores([np.zeros_like(each) for each in true], true, np.ones(4))
    assert (scores.correlation, scores.amplitude, scores.jerk) == (0, 0, 0)


def test_short_sentences_are_not_scored() -> None:
    predicted, true = trajectories(2)
    scores = trajectory_scores([*predicted, np.ones((3, 4))], [*true, np.zeros((3, 4))], np.ones(4))
    assert scores == trajectory_scores(predicted, true, np.ones(4))
    with pytest.raises(ValueError, match="long enough"):
        trajectory_scores([np.ones((3, 4))], [np.zeros((3, 4))], np.ones(4))


def test_trajectories_of_other_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="shapes"):
        trajectory_scores([np.zeros((9, 4))], [np.zeros((8, 4))], np.ones(4))


@given(seeds)
def test_correlation_is_numpys(seed: int) -> None:
    random = np.random.default_rng(seed)
    a, b = random.standard_normal((2, 20, 3))
    assert correlation(a, b) == pytest.approx([np.corrcoef(a[:, k], b[:, k])[0, 1] for k in range(3)])
    assert (np.abs(correlation(a, b)) <= 1 + 1e-12).all()


def pictures(seed: int, count: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).uniform(16, 235, (count, 16, 24))


@given(seeds)
def test_psnr_is_what_plain_loops_give(seed: int) -> None:
    a, b = pictures(seed), pictures(seed + 1)
    for found, one, other in zip(psnr(a, b, WINDOW), a, b, strict=True):
        total = sum((one[y, x] - other[y, x]) ** 2 for y in range(2, 14) for x in range(3, 19))
        assert found == pytest.approx(10 * np.log10(255**2 / (total / (12 * 16))))


def test_only_the_window_counts() -> None:
    a, b = pictures(0), pictures(0)
    b[:, 0, 0] = 0
    assert psnr(a, b, WINDOW) == pytest.approx([10 * np.log10(PEAK**2 / NO_ERROR)] * 2)
    assert ssim(a, b, WINDOW) == pytest.approx([1, 1])


@settings(max_examples=20)
@given(seeds)
def test_ssim_is_symmetric_and_at_most_one(seed: int) -> None:
    a, b = pictures(seed), pictures(seed + 1)
    assert ssim(a, b, WINDOW) == pytest.approx(ssim(b, a, WINDOW))
    assert (ssim(a, b, WINDOW) < 1).all()


def test_picture_scores_sum_up() -> None:
    found = picture_scores(np.arange(11.0), np.full(11, 0.5))
    assert found is not None
    assert (found.psnr, found.psnr_p10, found.ssim, found.pictures) == (5, 1, 0.5, 11)
    assert picture_scores(np.zeros(0), np.zeros(0)) is None


def test_a_blurred_picture_has_less_gradient_energy() -> None:
    sharp = pictures(3)
    assert gradient_energy((sharp + np.roll(sharp, 1, 2)) / 2, WINDOW) < gradient_energy(sharp, WINDOW)


def openings(seed: int) -> list[np.ndarray]:
    random = np.random.default_rng(seed)
    return [np.convolve(random.standard_normal(90), np.hanning(5), "valid") for _ in range(3)]


@given(seeds, st.integers(-MOST_LAG, MOST_LAG), st.floats(0.2, 3), st.floats(-5, 5))
def test_a_shifted_opening_shows_its_lag_whatever_its_size_and_offset(
    seed: int, lag: int, gain: float, offset: float
) -> None:
    whole = openings(seed)
    true = [each[MOST_LAG:-MOST_LAG] for each in whole]
    late = [gain * np.roll(each, lag)[MOST_LAG:-MOST_LAG] + offset for each in whole]
    found = opening_scores(late, true)
    assert found is not None
    assert found.lag == lag
    assert found.correlation > 0.97


def test_amplitude_is_a_ratio_of_deviations() -> None:
    true = openings(5)
    found = opening_scores([0.8 * each + 1 for each in true], true)
    assert found is not None
    assert (found.correlation, found.lag, found.amplitude) == (pytest.approx(1), 0, pytest.approx(0.8))


def test_a_mouth_that_stays_shut_has_no_lag() -> None:
    true = openings(6)
    found = opening_scores([np.zeros_like(each) for each in true], true)
    assert found is not None
    assert (found.correlation, found.lag, found.amplitude) == (0, 0, 0)


def test_sentences_shorter_than_the_lags_have_no_opening_scores() -> None:
    assert opening_scores([np.arange(2.0 * MOST_LAG)], [np.arange(2.0 * MOST_LAG)]) is None


def test_what_only_moves_by_rounding_does_not_move() -> None:
    random = np.random.default_rng(0)
    moving = random.standard_normal((50, 2))
    still = np.full((50, 2), 7.0) + 1e-5 * random.standard_normal((50, 2))
    assert not correlation(still, moving).any()
    assert not correlation(moving, still).any()
    assert (np.abs(correlation(still + 0.01 * moving, moving)) > 0.9).all()
