from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.models.model import Spoken
from app.engine.states import VISEMES, parent, plain, segments, viseme
from app.engine.training.fit_trajectory import (
    Options,
    Target,
    descent,
    fit_trajectory,
    gradients,
    parents,
    state_statistics,
    targets,
    untrained,
)
from app.engine.trajectory import GaussianTrajectory
from app.errors import TrainingFailed
from app.speech import SILENCE, Phone

Array = NDArray[np.float64]
FRAMES = 60


@pytest.fixture
def phones() -> tuple[Phone, ...]:
    spoken = ("SIL", "AA", "M", "AY", "S", "AA", "SIL", "M", "AA", "S", "SIL")
    lengths = (0.4, 0.11, 0.07, 0.23, 0.12, 0.2, 0.5, 0.08, 0.21, 0.13, 0.35)
    edges = np.concatenate([[0], np.cumsum(lengths)])
    return tuple(Phone(s, float(a), float(b)) for s, a, b in zip(spoken, edges, edges[1:], strict=False))


def model_of(phones: tuple[Phone, ...], seed: int, count: int = 3) -> GaussianTrajectory:
    random = np.random.default_rng(seed)
    found = {segment.state for segment in segments(phones)}
    states = tuple(sorted(found | {parent(state) for state in found}))
    shape = (len(states), count)
    return GaussianTrajectory(
        states, random.standard_normal(shape), random.uniform(0.5, 4, shape), np.zeros(count), np.ones(count)
    )


def passage_of(
    model: GaussianTrajectory, phones: tuple[Phone, ...], target: Array, counted: Array | None = None
) -> Target:
    used = np.ones((len(target), 1)) if counted is None else counted
    return Target(model.occupancy(phones, len(target)), target, used)


def some_counted(seed: int = 7) -> Array:
    return (np.random.default_rng(seed).random((FRAMES, 1)) < 0.7).astype(float)


def recorded(phones: tuple[Phone, ...], seed: int = 5) -> Spoken:
    truth = replace(model_of(phones, seed), offset=np.array([5.0, -3, 100]), scale=np.array([2.0, 0.5, 30]))
    noise = np.random.default_rng(seed).standard_normal((FRAMES, 3)) * 0.05 * truth.scale
    return Spoken(phones, (truth.predict(phones, FRAMES) + noise).astype(np.float32), np.ones(FRAMES, bool))


def error_of(model: GaussianTrajectory, spoken: Spoken) -> float:
    shown = model.predict(spoken.phones, len(spoken.counted))
    return float((((shown - spoken.coefficients) / model.scale) ** 2)[spoken.counted].mean())


def test_gradients_are_those_of_finite_differences(phones: tuple[Phone, ...]) -> None:
    model, counted = model_of(phones, 1), some_counted()
    target = np.random.default_rng(2).standard_normal((FRAMES, 3))
    passage = passage_of(model, phones, target, counted)
    error, by_mean, by_precision = gradients(model, passage)
    logarithm = np.log(model.precision)

    def measured(mean: Array, log_precision: Array) -> float:
        changed = replace(model, mean=mean, precision=np.exp(log_precision))
        shown = changed.smooth(*changed.targets(passage.shown))
        return float(0.5 * sum(((shown[t] - target[t]) ** 2).sum() for t in range(FRAMES) if counted[t]))

    assert error == pytest.approx(measured(model.mean, logarithm))
    step = 1e-5
    for state in range(0, len(model.states), 2):
        for k in range(3):
            nudge = np.zeros_like(model.mean)
            nudge[state, k] = step
            for found, up, down in (
                (by_mean, (model.mean + nudge, logarithm), (model.mean - nudge, logarithm)),
                (by_precision, (model.mean, logarithm + nudge), (model.mean, logarithm - nudge)),
            ):
                slope = (measured(*up) - measured(*down)) / (2 * step)
                assert found[state, k] == pytest.approx(slope, rel=1e-5, abs=1e-6)


def test_what_frames_that_do_not_count_show_does_not_matter(phones: tuple[Phone, ...]) -> None:
    model, counted = model_of(phones, 1), some_counted()
    target = np.random.default_rng(2).standard_normal((FRAMES, 3))
    poisoned = np.where(counted > 0, target, 1e6)
    clean, spoilt = (gradients(model, passage_of(model, phones, each, counted)) for each in (target, poisoned))
    for a, b in zip(clean, spoilt, strict=True):
        np.testing.assert_array_equal(a, b)


def plain_statistics(passages: list[Target], states: tuple[str, ...], options: Options) -> tuple[Array, Array]:
    """Statistics of states by plain loops: of the recording, then of visemes, then of parents, then of contexts."""
    rows = [
        (passage.target[t], [
            (states[passage.shown.states[t, slot]], passage.shown.share[t, slot])
            for slot in range(passage.shown.share.shape[1]) if passage.shown.share[t, slot] > 0
        ])
        for passage in passages for t in range(len(passage.target)) if passage.counted[t, 0]
    ]  # fmt: skip
    everything = np.array([target for target, _ in rows])
    overall = everything.mean(0), everything.var(0)

    def shrunk(belongs, prior, mean_frames: float, variance_frames: float):  # type: ignore[no-untyped-def]
        weights = [sum(share for state, share in shown if belongs(state)) for _, shown in rows]
        count = sum(weights)
        total = sum(weight * target for weight, (target, _) in zip(weights, rows, strict=True))
        mean = (total + mean_frames * prior[0]) / (count + mean_frames)
        scatter = sum(weight * (target - mean) ** 2 for weight, (target, _) in zip(weights, rows, strict=True))
        return mean, (scatter + variance_frames * prior[1]) / (count + variance_frames)

    settings = options.mean_shrinkage, options.variance_shrinkage
    contexts = options.context_shrinkage, options.context_shrinkage
    means, variances = [], []
    for state in states:
        look, family = viseme(state), parent(state)
        looks = shrunk(partial(lambda at, other: viseme(other) == at, look), overall, 2.0, 5.0)
        mean, variance = wide = shrunk(partial(lambda at, other: parent(other) == at, family), looks, *settings)
        if state != family:  # a parent is its own prior: all its frames are in it
            mean, variance = shrunk(partial(lambda at, other: other == at, state), wide, *contexts)
        means.append(mean)
        variances.append(np.maximum(variance, options.variance_floor))
    return np.array(means), np.array(variances)


def test_statistics_shrink_from_contexts_to_parents_to_visemes_to_everything(phones: tuple[Phone, ...]) -> None:
    model = model_of(phones, 1)
    random = np.random.default_rng(3)
    passages = [passage_of(model, phones, random.standard_normal((FRAMES, 3)), some_counted(seed)) for seed in (0, 1)]
    options = Options(mean_shrinkage=1.7, context_shrinkage=6.1, variance_shrinkage=4.2, variance_floor=0.01)
    found = state_statistics(passages, model.states, options)
    expected = plain_statistics(passages, model.states, options)
    np.testing.assert_allclose(found[0], expected[0], atol=1e-9)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-9)


def test_with_much_shrinkage_what_looks_alike_is_alike_and_variances_have_a_floor(phones: tuple[Phone, ...]) -> None:
    model = model_of(phones, 1)
    passages = [passage_of(model, phones, np.random.default_rng(3).standard_normal((FRAMES, 3)))]
    mean, _ = state_statistics(
        passages, model.states, Options(mean_shrinkage=1e9, context_shrinkage=1e9, variance_shrinkage=1e9)
    )
    rows = [row for row, state in enumerate(model.states) if viseme(state) == viseme("AY")]
    assert {plain(model.states[row]) for row in rows} == {"AA", "AY"} <= set(VISEMES[viseme("AY")])
    np.testing.assert_allclose(mean[rows], mean[rows[:1]].repeat(len(rows), 0), atol=1e-6)
    still = [passage_of(model, phones, np.zeros((FRAMES, 3)))]
    _, variance = state_statistics(still, model.states, Options(variance_floor=0.3))
    assert (variance == 0.3).all()


def test_parents_are_found_by_name() -> None:
    states = ("AA.0", "AA.0|P", "AA.1", "SIL", "SIL.after0", "SIL.after0|AA")
    assert parents(states).tolist() == [0, 0, 2, 3, 4, 4]


def test_descent_lowers_the_error_and_leaves_silence_as_it_is(phones: tuple[Phone, ...]) -> None:
    spoken = [recorded(phones)]
    start = untrained(spoken, spoken[0].coefficients[:4].mean(0), fps=25, options=Options())
    options = Options(epochs=60, pull=0)
    models = list(descent(start, spoken, options))
    assert len(models) == 60
    errors = [gradients(model, targets(model, spoken)[0])[0] for model in (start, models[9], models[-1])]
    assert errors[2] < errors[1] < errors[0]
    assert errors[2] < 0.2 * errors[0]
    frozen = start.states.index(SILENCE)
    for model in models:
        np.testing.assert_array_equal(model.mean[frozen], start.mean[frozen])
        np.testing.assert_allclose(model.precision[frozen], start.precision[frozen])
        assert (model.precision > 0).all()


def test_a_strong_pull_keeps_the_statistics(phones: tuple[Phone, ...]) -> None:
    spoken = [recorded(phones)]
    start = untrained(spoken, spoken[0].coefficients[:4].mean(0), fps=25, options=Options())
    loose, tight = (list(descent(start, spoken, Options(epochs=30, pull=pull)))[-1] for pull in (0.0, 100.0))
    assert np.abs(tight.mean - start.mean).max() < 0.3 * np.abs(loose.mean - start.mean).max()


def test_what_is_learnt_in_one_context_moves_its_parent_and_through_it_the_others(phones: tuple[Phone, ...]) -> None:
    # AA.0 is seen after silence and after M; only the first stretch, which has no M, is trained on.
    spoken = recorded(phones)
    start = untrained([spoken], spoken.coefficients[:4].mean(0), fps=25, options=Options())
    short = Spoken(phones[:2], spoken.coefficients[:13] + 4 * start.scale.astype(np.float32), np.ones(13, bool))
    trained = list(descent(start, [short], Options(epochs=20, pull=0)))[-1]
    moved = trained.mean - start.mean
    names = {state: number for number, state in enumerate(start.states)}
    assert np.abs(moved[names["AA.0"]]).min() > 0.1
    np.testing.assert_allclose(moved[names["AA.0|P"]], moved[names["AA.0"]], atol=1e-9)
    assert np.abs(moved[names["AA.0|SIL"]] - moved[names["AA.0"]]).min() > 0.01
    assert not moved[names["AY.1"]].any()


def test_a_fitted_model_says_what_was_recorded(phones: tuple[Phone, ...]) -> None:
    spoken = recorded(phones)
    rest = spoken.coefficients[:4].mean(0)
    told: list[float] = []
    model = fit_trajectory([spoken], rest, fps=25, options=Options(), progress=told.append)
    assert error_of(model, spoken) < 0.1
    np.testing.assert_allclose(model.offset, spoken.coefficients.mean(0), rtol=1e-5)
    np.testing.assert_allclose(model.scale, spoken.coefficients.std(0), rtol=1e-4)
    np.testing.assert_allclose(model.rest, rest, rtol=1e-4)
    assert (model.fps, model.order, model.smoothness, model.lead) == (25, 2, 1.0, Options().lead)
    assert told == [epoch / 40 for epoch in range(1, 41)]


def test_training_is_better_than_the_statistics(phones: tuple[Phone, ...]) -> None:
    spoken = recorded(phones)
    rest = spoken.coefficients[:4].mean(0)
    errors = [
        error_of(fit_trajectory([spoken], rest, fps=25, options=Options(epochs=epochs)), spoken) for epochs in (0, 40)
    ]
    assert errors[1] < 0.8 * errors[0]


def parts_of(spoken: Spoken) -> list[Spoken]:
    """A recording in three stretches."""
    return [
        Spoken(
            tuple(
                Phone(p.symbol, max(p.start - start / 25, 0), min(p.end - start / 25, (stop - start) / 25))
                for p in spoken.phones
                if p.end * 25 > start and p.start * 25 < stop
            ),
            spoken.coefficients[start:stop], spoken.counted[start:stop],
        )
        for start, stop in ((0, 20), (20, 40), (40, FRAMES))
    ]  # fmt: skip


def test_the_same_seed_gives_the_same_model(phones: tuple[Phone, ...]) -> None:
    spoken = recorded(phones)
    rest = spoken.coefficients[:4].mean(0)
    first, again, other = (
        fit_trajectory(parts_of(spoken), rest, fps=25, options=Options(seed=seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.mean, again.mean)
    np.testing.assert_array_equal(first.precision, again.precision)
    assert (first.mean != other.mean).any()


def test_frames_that_do_not_count_are_never_looked_at(phones: tuple[Phone, ...]) -> None:
    spoken = recorded(phones)
    counted = some_counted()[:, 0] > 0
    poisoned = np.where(counted[:, None], spoken.coefficients, np.float32(1e6))
    rest = spoken.coefficients[:4].mean(0)
    clean, spoilt = (
        fit_trajectory([Spoken(phones, each, counted)], rest, fps=25, options=Options(epochs=5))
        for each in (spoken.coefficients, poisoned)
    )
    for name in ("mean", "precision", "offset", "scale"):
        np.testing.assert_array_equal(getattr(clean, name), getattr(spoilt, name), err_msg=name)
    assert clean.states == spoilt.states


def test_only_states_that_were_seen_and_their_parents_are_in_the_model(phones: tuple[Phone, ...]) -> None:
    spoken = recorded(phones)
    counted = np.zeros(FRAMES, bool)
    counted[12:18] = True  # AA, M and the first half of AY
    model = fit_trajectory(
        [replace(spoken, counted=counted)], spoken.coefficients[:4].mean(0), fps=25, options=Options(lead=0.05)
    )
    seen = set()
    for frame in range(12, 18):
        shown = frame / 25 + 0.05 - 0.02, frame / 25 + 0.05 + 0.02
        seen |= {each.state for each in segments(phones) if each.end > shown[0] + 1e-9 and each.start < shown[1] - 1e-9}
    assert set(model.states) == seen | {parent(state) for state in seen} | {SILENCE}
    assert not [state for state in model.states if state.startswith("S.")]
    assert np.isfinite(model.predict(phones, FRAMES)).all()


def test_neighbours_never_seen_fall_back_to_the_parent(phones: tuple[Phone, ...]) -> None:
    spoken = recorded(phones)
    model = fit_trajectory([spoken], spoken.coefficients[:4].mean(0), fps=25, options=Options(epochs=5))
    unseen = [Phone("UW", 0, 0.2), Phone("AA", 0.2, 0.6), Phone("UW", 0.6, 0.8)]
    shown = model.occupancy(unseen, 20)
    assert model.states[shown.states[8, 0]] == "AA.0"
    assert model.states[shown.states[12, 0]] == "AA.1"


def test_without_contexts_there_is_one_gaussian_a_phone(phones: tuple[Phone, ...]) -> None:
    spoken = recorded(phones)
    options = Options(contexts=False, epochs=3)
    model = fit_trajectory([spoken], spoken.coefficients[:4].mean(0), fps=25, options=options)
    assert set(model.states) == {plain(segment.state) for segment in segments(phones)}
    assert {"AA", "M", "AY", "S", SILENCE, "SIL.after0"} <= set(model.states)


def test_a_recording_in_which_nothing_is_said_teaches_no_speech(phones: tuple[Phone, ...]) -> None:
    spoken = recorded(phones)
    counted = np.arange(FRAMES) < 8
    with pytest.raises(TrainingFailed, match="nothing is said"):
        untrained([replace(spoken, counted=counted)], spoken.coefficients[0], fps=25, options=Options())
