from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.states import VISEMES, occupancy, segments
from app.engine.training.fit_trajectory import (
    Options,
    Passage,
    descend,
    fit_trajectory,
    gradients,
    state_statistics,
)
from app.engine.trajectory import GaussianTrajectory
from app.speech import SILENCE, Phone

Array = NDArray[np.float64]
FRAMES = 60


def quiet(_: float) -> None:
    """Nobody listens."""


@pytest.fixture
def phones() -> list[Phone]:
    spoken = ("SIL", "AA", "M", "AY", "S", "AA", "SIL", "M", "AA", "S", "SIL")
    lengths = (0.4, 0.11, 0.07, 0.23, 0.12, 0.2, 0.5, 0.08, 0.21, 0.13, 0.35)
    edges = np.concatenate([[0], np.cumsum(lengths)])
    return [Phone(s, float(a), float(b)) for s, a, b in zip(spoken, edges, edges[1:], strict=False)]


def model_of(phones: list[Phone], seed: int, count: int = 3) -> GaussianTrajectory:
    random = np.random.default_rng(seed)
    states = tuple(sorted({segment.state for segment in segments(phones)}))
    shape = (len(states), count)
    return GaussianTrajectory(
        states, random.standard_normal(shape), random.uniform(0.5, 4, shape), np.zeros(count), np.ones(count)
    )


def passage_of(model: GaussianTrajectory, phones: list[Phone], target: Array) -> Passage:
    return Passage(model.occupancy(phones, len(target)), target)


def test_gradients_are_those_of_finite_differences(phones: list[Phone]) -> None:
    model = model_of(phones, 1)
    passage = passage_of(model, phones, np.random.default_rng(2).standard_normal((FRAMES, 3)))
    error, by_mean, by_precision = gradients(model, passage)
    logarithm = np.log(model.precision)

    def measured(mean: Array, log_precision: Array) -> float:
        return gradients(replace(model, mean=mean, precision=np.exp(log_precision)), passage)[0]

    shown = model.smooth(*model.targets(passage.shown))
    assert error == pytest.approx(0.5 * ((shown - passage.target) ** 2).sum())
    step = 1e-5
    for state in range(len(model.states)):
        for k in range(3):
            nudge = np.zeros_like(model.mean)
            nudge[state, k] = step
            for found, up, down in (
                (by_mean, (model.mean + nudge, logarithm), (model.mean - nudge, logarithm)),
                (by_precision, (model.mean, logarithm + nudge), (model.mean, logarithm - nudge)),
            ):
                slope = (measured(*up) - measured(*down)) / (2 * step)
                assert found[state, k] == pytest.approx(slope, rel=1e-5, abs=1e-6)


def test_statistics_without_shrinkage_are_weighted_by_the_shares(phones: list[Phone]) -> None:
    model = model_of(phones, 1)
    target = np.random.default_rng(3).standard_normal((FRAMES, 3))
    passages = [passage_of(model, phones, target)]
    plain = Options(mean_shrinkage=0, variance_shrinkage=0, variance_floor=0)
    mean, variance = state_statistics(passages, model.states, plain)
    shown = passages[0].shown
    for state in range(len(model.states)):
        weight = np.where(shown.states == state, shown.share, 0).sum(1)
        expected = np.average(target, axis=0, weights=weight)
        np.testing.assert_allclose(mean[state], expected, atol=1e-9)
        np.testing.assert_allclose(
            variance[state], np.average((target - expected) ** 2, axis=0, weights=weight), atol=1e-9
        )


def test_statistics_shrink_towards_those_that_look_alike_and_have_a_floor(phones: list[Phone]) -> None:
    model = model_of(phones, 1)
    target = np.random.default_rng(3).standard_normal((FRAMES, 3))
    passages = [passage_of(model, phones, target)]
    mean, variance = state_statistics(passages, model.states, Options(mean_shrinkage=1e9, variance_shrinkage=1e9))
    alike = next(members for members in VISEMES if "AA" in members)
    rows = [model.states.index(state) for state in ("AA", "AY.0", "AY.1")]
    assert {"AA", "AY"} <= set(alike)
    np.testing.assert_allclose(mean[rows], mean[rows[:1]].repeat(3, 0), atol=1e-6)
    still = [passage_of(model, phones, np.zeros((FRAMES, 3)))]
    _, variance = state_statistics(still, model.states, Options(variance_floor=0.3))
    assert (variance == 0.3).all()


def test_descending_lowers_the_error_of_what_is_shown(phones: list[Phone]) -> None:
    truth, start = model_of(phones, 1), model_of(phones, 2)
    target = truth.smooth(*truth.targets(truth.occupancy(phones, FRAMES)))
    passages = [passage_of(start, phones, target)]
    told: list[float] = []
    options = Options(epochs=80, pull=0)
    found = descend(start, passages, options, frozen=start.states.index(SILENCE), progress=told.append)
    before, after = gradients(start, passages[0])[0], gradients(found, passages[0])[0]
    assert after < 0.1 * before
    assert (found.precision > 0).all()
    assert told == [epoch / 80 for epoch in range(80)]
    frozen = start.states.index(SILENCE)
    np.testing.assert_array_equal(found.mean[frozen], start.mean[frozen])
    np.testing.assert_allclose(found.precision[frozen], start.precision[frozen])


def test_a_strong_pull_keeps_the_statistics(phones: list[Phone]) -> None:
    start = model_of(phones, 2)
    passages = [passage_of(start, phones, np.random.default_rng(4).standard_normal((FRAMES, 3)))]
    loose, tight = (
        descend(start, passages, Options(epochs=30, pull=pull), frozen=0, progress=quiet) for pull in (0.0, 100.0)
    )
    assert np.abs(tight.mean - start.mean).max() < 0.3 * np.abs(loose.mean - start.mean).max()


def recorded(phones: list[Phone], seed: int = 5) -> NDArray[np.float32]:
    truth = replace(model_of(phones, seed), offset=np.array([5.0, -3, 100]), scale=np.array([2.0, 0.5, 30]))
    noise = np.random.default_rng(seed).standard_normal((FRAMES, 3)) * 0.05 * truth.scale
    return (truth.predict(phones, FRAMES) + noise).astype(np.float32)


def fitted(
    coefficients: NDArray[np.float32], phones: list[Phone], spans: list[range], seed: int = 0
) -> GaussianTrajectory:
    rest = coefficients[:4].mean(0)
    return fit_trajectory(coefficients, phones, spans, rest, fps=25, options=Options(seed=seed))


def test_a_fitted_model_says_what_was_recorded(phones: list[Phone]) -> None:
    coefficients = recorded(phones)
    model = fitted(coefficients, phones, [range(0, 30), range(30, FRAMES)])
    error = np.sqrt(((model.predict(phones, FRAMES) - coefficients) ** 2).mean(0)) / coefficients.std(0)
    assert error.max() < 0.5
    assert error.mean() < 0.3
    np.testing.assert_allclose(model.offset, coefficients.mean(0), rtol=1e-5)
    np.testing.assert_allclose(model.scale, coefficients.std(0), rtol=1e-4)
    np.testing.assert_allclose(model.rest, coefficients[:4].mean(0), rtol=1e-4)
    assert (model.fps, model.order, model.smoothness) == (25, 2, 2.0)


def test_training_is_better_than_the_statistics(phones: list[Phone]) -> None:
    coefficients, spans = recorded(phones), [range(FRAMES)]
    rest = coefficients[:4].mean(0)
    errors = [
        (
            (
                fit_trajectory(coefficients, phones, spans, rest, fps=25, options=options).predict(phones, FRAMES)
                - coefficients
            )
            ** 2
            / coefficients.var(0)
        ).mean()
        for options in (Options(epochs=0), Options())
    ]
    assert errors[1] < 0.8 * errors[0]


def test_the_same_seed_gives_the_same_model(phones: list[Phone]) -> None:
    coefficients, spans = recorded(phones), [range(0, 20), range(20, 40), range(40, FRAMES)]
    first, again = (fitted(coefficients, phones, spans, seed=1) for _ in range(2))
    np.testing.assert_array_equal(first.mean, again.mean)
    np.testing.assert_array_equal(first.precision, again.precision)


def test_frames_outside_the_spans_are_never_looked_at(phones: list[Phone]) -> None:
    coefficients = recorded(phones)
    poisoned = coefficients.copy()
    poisoned[30:] = np.random.default_rng(0).standard_normal((FRAMES - 30, 3)) * 1e6
    clean, spoilt = (fitted(each, phones, [range(30)]) for each in (coefficients, poisoned))
    np.testing.assert_array_equal(clean.mean, spoilt.mean)
    np.testing.assert_array_equal(clean.precision, spoilt.precision)
    np.testing.assert_array_equal(clean.scale, spoilt.scale)


def test_states_that_were_not_seen_are_not_in_the_model(phones: list[Phone]) -> None:
    model = fitted(recorded(phones), phones, [range(12, 18)])  # AA, M and the first half of AY
    everything = {segment.state for segment in segments(phones)}
    names = {state: number for number, state in enumerate(sorted(everything))}
    shown = occupancy(segments(phones), names, FRAMES, fps=25, lead=0.05, cap=12)
    seen = {sorted(everything)[state] for state in shown.states[12:18][shown.share[12:18] > 0]}
    assert set(model.states) == seen | {SILENCE}
    assert "S" not in model.states
    assert np.isfinite(model.predict(phones, FRAMES)).all()
