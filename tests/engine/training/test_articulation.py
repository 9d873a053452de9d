from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from drawn_recording import LOWERED
from numpy.typing import NDArray

from app.engine.metrics import trajectory_scores
from app.engine.models.model import Spoken
from app.engine.training import articulation as module
from app.engine.training.appearance import Appearance
from app.engine.training.articulation import (
    EVERY,
    LEAD,
    SMOOTHNESS,
    TRAINED_SMOOTHNESS,
    learn_articulation,
    rest_offset,
    spoken_passages,
)
from app.engine.training.corpus import Corpus
from app.engine.training.fit_trajectory import Options, descent, fit_trajectory, untrained
from app.engine.trajectory import GaussianTrajectory
from app.speech import SILENCE, Phone

Float = NDArray[np.float32]


@cache
def talker(lead: float = 0.06, count: int = 9) -> tuple[Spoken, ...]:
    """Passages of a talker whose five coefficients follow the phones by rule, so far ahead of the sound."""
    random = np.random.default_rng(1)
    look = {symbol: random.standard_normal(5) * (5, 3, 2, 1, 1) for symbol in ("AA", "M", "S", "UW", "EH", "P")}
    look[SILENCE] = np.zeros(5)
    found = []
    for _ in range(count):
        symbols = [SILENCE, *random.choice(["AA", "M", "S", "UW", "EH", "P"], 14), SILENCE]
        lengths = [0.5, *random.uniform(0.08, 0.2, 14), 0.5]
        edges = np.concatenate([[0], np.cumsum(lengths)])
        phones = tuple(Phone(str(s), float(a), float(b)) for s, a, b in zip(symbols, edges, edges[1:], strict=False))
        frames = round(edges[-1] * 25)
        fine = (np.arange(frames * 10) + 0.5) / 250 + lead - 0.02
        raw = np.array([look[next((p.symbol for p in phones if t < p.end), SILENCE)] for t in fine])
        window = np.hanning(25)
        padded = np.pad(raw, ((12, 12), (0, 0)), mode="edge")
        smooth = np.stack([np.convolve(column, window / window.sum(), "valid") for column in padded.T])
        rows = smooth.T.reshape(frames, 10, 5).mean(1) + 0.02 * random.standard_normal((frames, 5))
        found.append(Spoken(phones, rows.astype(np.float32), np.ones(frames, bool)))
    return tuple(found)


REST = np.zeros(5, np.float32)
SHORT = 8
"""Epochs."""


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "EPOCHS", SHORT)


def poisoned(spoken: Spoken) -> Spoken:
    wild = np.random.default_rng(0).standard_normal(spoken.coefficients.shape) * 1e3
    return replace(spoken, coefficients=wild.astype(np.float32))


def test_every_passages_mouth_at_rest_is_moved_to_the_common_one(corpus: Corpus, appearance: Appearance) -> None:
    found = spoken_passages(corpus, appearance.coefficients, appearance.rest)
    assert len(found) == len(corpus.passages) == len(LOWERED)
    before, after = [], []
    for passage, spoken in zip(corpus.passages, found, strict=True):
        frames = np.arange(passage.frames.start, passage.frames.stop)
        assert list(spoken.phones) == corpus.phones(passage)
        np.testing.assert_array_equal(spoken.counted, corpus.good[frames])
        resting = corpus.rest[frames] & corpus.good[frames]
        before.append(appearance.coefficients[frames][resting].mean(0) - appearance.rest)
        after.append(spoken.coefficients[resting].mean(0) - appearance.rest)
        moved = appearance.coefficients[frames] - spoken.coefficients
        np.testing.assert_allclose(moved, np.broadcast_to(before[-1], moved.shape), atol=1e-2)
    assert np.abs(after).max() < 1e-2
    assert np.abs(before).max() > 5, "the drawn passages do rest differently"


def test_a_passage_that_does_not_rest_stays_as_it_is(corpus: Corpus, appearance: Appearance) -> None:
    frames = np.arange(corpus.passages[2].frames.start, corpus.passages[2].frames.stop)
    restless = replace(corpus, rest=np.zeros_like(corpus.rest))
    assert not rest_offset(restless, appearance.coefficients, appearance.rest, frames).any()
    broken = replace(corpus, good=np.zeros_like(corpus.good))
    assert not rest_offset(broken, appearance.coefficients, appearance.rest, frames).any()


def test_the_settings_that_fit_the_talker_are_chosen() -> None:
    for lead in (0.0, 0.06):
        found = learn_articulation(talker(lead), REST, seed=0)
        assert found.options.lead in LEAD
        assert found.options.smoothness in SMOOTHNESS
        assert abs(found.options.lead - lead) <= 0.021
        assert found.options.epochs > 0
        assert (found.model.lead, found.model.smoothness) == (found.options.lead, found.options.smoothness)


PARTS = ((0, 6), (1, 7), (2, 8), (3,), (4,), (5,))
"""Of nine passages, those that are left out together."""


def left_out_errors(spoken: Sequence[Spoken], options: Options, epochs: int) -> list[float]:
    """The error on what was left out, each passage once, after no epoch and after each."""
    shown: list[list[Float]] = [[] for _ in range(epochs + 1)]
    true, scales = [], [[] for _ in range(epochs + 1)]
    for part in PARTS:
        learnt = [each for number, each in enumerate(spoken) if number not in part]
        start = untrained(learnt, REST, fps=25, options=options)
        true += [spoken[number].coefficients for number in part]
        for epoch, model in enumerate([start, *descent(start, learnt, replace(options, epochs=epochs))]):
            shown[epoch] += [model.predict(spoken[n].phones, len(spoken[n].counted)) for n in part]
            scales[epoch].append(model.scale)
    return [
        trajectory_scores(rows, true, np.mean(scale, 0)).error_weighted
        for rows, scale in zip(shown, scales, strict=True)
    ]  # fmt: skip


def test_no_other_settings_do_better_on_what_was_left_out() -> None:
    spoken = talker()
    found = learn_articulation(spoken, REST, seed=0)
    assert found.validation == tuple(range(9))
    plain, trained_plain, wide, trained = (trial.scores.error_weighted for trial in found.trials)
    errors = {
        (lead, smoothness): left_out_errors(spoken, Options(lead=lead, smoothness=smoothness), 0)[0]
        for lead in LEAD for smoothness in SMOOTHNESS
    }  # fmt: skip
    assert wide == pytest.approx(min(errors.values()))
    assert trained_plain <= plain
    lead = min(errors, key=errors.__getitem__)[0]
    along = {
        smoothness: left_out_errors(spoken, Options(lead=lead, smoothness=smoothness), SHORT)
        for smoothness in TRAINED_SMOOTHNESS
    }  # fmt: skip
    assert trained == pytest.approx(min(min(each[::EVERY]) for each in along.values()))
    assert found.options.lead == lead
    assert along[found.options.smoothness][found.options.epochs] == pytest.approx(trained)


def test_of_many_passages_one_part_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "FEW", 9)
    found = learn_articulation(talker(), REST, seed=0)
    assert found.validation == (3,)
    assert len(found.predicted) == 1


def test_the_last_trials_predictions_are_handed_on_and_the_shipped_model_is_learnt_from_everything() -> None:
    spoken = talker()
    found = learn_articulation(spoken, REST, seed=0)
    unheard, own = [], []
    for number, rows in zip(found.validation, found.predicted, strict=True):
        assert rows.shape == spoken[number].coefficients.shape
        unheard.append(((rows - spoken[number].coefficients) ** 2).mean())
        own.append(((found.model.predict(spoken[number].phones, len(rows)) - spoken[number].coefficients) ** 2).mean())
    assert np.mean(own) < np.mean(unheard)
    shipped = fit_trajectory(spoken, REST, fps=25, options=found.options)
    np.testing.assert_array_equal(shipped.mean, found.model.mean)


def test_nothing_in_the_trials_is_learnt_from_the_passages_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    spoken = talker()
    made: list[list[GaussianTrajectory]] = []

    def spied(fit: Callable[..., GaussianTrajectory]) -> Callable[..., GaussianTrajectory]:
        def called(*args: Any, **options: Any) -> GaussianTrajectory:
            made[-1].append(fit(*args, **options))
            return made[-1][-1]

        return called

    monkeypatch.setattr(module, "untrained", spied(untrained))
    trained_on: list[list[Spoken]] = []

    def spied_descent(
        model: GaussianTrajectory, learnt: Sequence[Spoken], options: Options
    ) -> Iterator[GaussianTrajectory]:
        trained_on.append(list(learnt))
        return descent(model, learnt, options)

    monkeypatch.setattr(module, "descent", spied_descent)
    for changed in (spoken[3], poisoned(spoken[3])):
        made.append([])
        trained_on.clear()
        learn_articulation([*spoken[:3], changed, *spoken[4:]], REST, seed=0)
        assert len(trained_on) == len(PARTS) * 2 * len(TRAINED_SMOOTHNESS)
        for call, learnt in enumerate(trained_on):
            assert len(learnt) == 9 - len(PARTS[call % len(PARTS)])
            assert any(each is changed for each in learnt) == (call % len(PARTS) != 3)
    tried = len(LEAD) * len(SMOOTHNESS)
    block = tried + len(TRAINED_SMOOTHNESS)
    assert len(made[0]) == len(made[1]) == len(PARTS) * 2 * (tried + len(TRAINED_SMOOTHNESS))
    for number in (*range(tried), *range(block, block + tried)):
        clean, spoilt = (each[number * len(PARTS) + 3] for each in made)
        assert clean.states == spoilt.states
        np.testing.assert_array_equal(clean.mean, spoilt.mean)
        np.testing.assert_array_equal(clean.precision, spoilt.precision)
        np.testing.assert_array_equal(clean.scale, spoilt.scale)


def test_a_short_recording_keeps_the_defaults() -> None:
    told: list[float] = []
    found = learn_articulation(talker()[:3], REST, seed=3, progress=told.append)
    assert found.options == Options(seed=3)
    assert (found.trials, found.validation, found.predicted) == ((), (), ())
    assert (found.model.lead, found.model.smoothness) == (Options().lead, Options().smoothness)
    assert told[-1] == 1


def test_passages_without_a_frame_that_counts_are_left_out() -> None:
    spoken = list(talker())
    nothing = np.zeros(len(spoken[1].counted), bool)
    gone = [replace(each, counted=nothing) if number == 1 else each for number, each in enumerate(spoken)]
    wild = [replace(poisoned(each), counted=nothing) if number == 1 else each for number, each in enumerate(spoken)]
    first, second = (learn_articulation(each, REST, seed=0) for each in (gone, wild))
    np.testing.assert_array_equal(first.model.mean, second.model.mean)
    assert first.validation == second.validation == (0, 2, 3, 4, 5, 6, 7, 8)
    few = [replace(each, counted=each.counted & (number >= 6)) for number, each in enumerate(spoken)]
    assert learn_articulation(few, REST, seed=0).validation == ()


def test_progress_goes_up_to_one_and_the_same_seed_gives_the_same() -> None:
    told: list[float] = []
    first = learn_articulation(talker(), REST, seed=2, progress=told.append)
    again = learn_articulation(talker(), REST, seed=2)
    np.testing.assert_array_equal(first.model.mean, again.model.mean)
    assert told == sorted(told)
    assert 0 < told[0] <= told[-1] == pytest.approx(1)
    assert [trial.name[:3] for trial in first.trials] == ["one", "the", "Gau", "the"]
