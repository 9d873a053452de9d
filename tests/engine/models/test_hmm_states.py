from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from app.engine.models.hmm_context import contexts
from app.engine.models.hmm_states import (
    MOST,
    QUIET_STATES,
    REST_SLOT,
    SPEECH,
    Durations,
    add_fits,
    align,
    even_durations,
    learnt_durations,
    phone_rows,
    shared_rows,
    slots_of,
)
from app.speech import PHONES, SILENCE, Phone

PLAIN = ("SIL", "AA", "B", "S")


def said(*symbols: str) -> list[Phone]:
    return [Phone(symbol, 0.1 * at, 0.1 * (at + 1)) for at, symbol in enumerate(symbols)]


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(3, 11))
def test_states_lie_where_no_other_division_is_likelier(seed: int, rows: int) -> None:
    fits = np.random.default_rng(seed).standard_normal((rows, MOST))
    states = np.zeros((1, MOST), np.int64)
    align(np.array([0, rows]), np.array([3]), fits, states)

    def likelihood(lengths: np.ndarray) -> float:
        return float(fits[np.arange(rows), np.repeat(np.arange(3), lengths)].sum())

    every = [np.diff([0, *cuts, rows]) for cuts in combinations(range(1, rows), 2)]
    assert likelihood(states[0, :3]) == pytest.approx(max(likelihood(each) for each in every))
    assert states[0, :3].min() >= 1
    assert states.sum() == rows


def test_phones_too_short_for_their_states_stay_as_they_are() -> None:
    states = np.array([[1, 0, 1, *[0] * (MOST - 3)]])
    align(np.array([0, 2]), np.array([3]), np.zeros((2, MOST)), states)
    assert states[0, :3].tolist() == [1, 0, 1]


def test_fits_are_log_densities_of_usable_rows() -> None:
    random = np.random.default_rng(0)
    rows, mean, variance = random.standard_normal((5, 4)), random.standard_normal((3, 4)), random.random((3, 4)) + 0.1
    leaves = np.zeros((2, MOST), np.int64)
    leaves[1, :3] = [2, 0, 1]
    fits = np.zeros((5, MOST))
    usable = np.array([True, True, True, True, False])
    add_fits(np.array([0, 2, 5]), np.array([3, 3]), leaves, rows, usable, mean, variance, fits)
    constant = 2 * np.log(2 * np.pi)
    for t, leaf in ((2, 2), (3, 2)):
        expected = norm.logpdf(rows[t], mean[leaf], np.sqrt(variance[leaf])).sum() + constant
        assert fits[t, 0] == pytest.approx(expected)
    assert not fits[4].any()
    assert not fits[:, 3:].any()


@given(st.lists(st.tuples(st.floats(1, 50), st.floats(0.25, 500)), min_size=1, max_size=7), st.integers(0, 300))
def test_states_share_all_rows(states: list[tuple[float, float]], length: int) -> None:
    mean, variance = np.array(states).T
    rows = shared_rows(mean, variance, length)
    assert rows.sum() == length
    assert rows.min() >= (1 if length > 2 * len(states) else 0)


def test_states_share_rows_as_is_likeliest() -> None:
    mean, variance = np.array([10.0, 20.0, 12.0]), np.array([4.0, 100.0, 9.0])
    best = max(
        (np.diff([0, *cuts, 60]) for cuts in combinations(range(1, 60), 2)),
        key=lambda lengths: norm.logpdf(lengths, mean, np.sqrt(variance)).sum(),
    )
    assert np.abs(shared_rows(mean, variance, 60) - best).max() <= 1


def test_silence_rests_where_nothing_is_beside_it() -> None:
    first, count = slots_of(contexts(said("SIL", "AA", "SIL", "B", "SIL"), PLAIN))
    half = QUIET_STATES // 2 + 1
    assert first.tolist() == [REST_SLOT, 0, SPEECH, 0, SPEECH]
    assert count.tolist() == [half, SPEECH, QUIET_STATES, SPEECH, half]
    first, count = slots_of(contexts(said("SIL"), PLAIN))
    assert (first.tolist(), count.tolist()) == ([REST_SLOT], [1])


def test_long_silence_is_rest_but_for_its_ends() -> None:
    labels = contexts(said("AA", "SIL", "AA"), PLAIN)
    states = even_durations().states(labels, np.array([30, 400, 30]))
    assert states[1, QUIET_STATES // 2] > 300
    assert states.sum(1).tolist() == [30, 400, 30]


def test_durations_are_learnt_of_each_phone_and_of_all_speech_where_it_is_rare() -> None:
    labels = contexts(said(*["AA"] * 6, "B"), PLAIN)
    states = np.zeros((7, MOST), np.int64)
    states[:6, :3] = [[2, 4, 6], [4, 4, 6], [2, 4, 6], [4, 4, 6], [2, 4, 6], [4, 4, 6]]
    states[6, :3] = [10, 4, 6]
    found = learnt_durations(labels, states)
    aa, b = PHONES.index("AA"), PHONES.index("B")
    assert found.mean[aa, :3].tolist() == [3, 4, 6]
    assert found.variance[aa, 0] == 1
    assert found.mean[b, 0] == 4
    assert np.array_equal(found.mean[PHONES.index(SILENCE)], even_durations().mean[PHONES.index(SILENCE)])


def test_rows_begin_with_their_phones() -> None:
    edges = phone_rows([Phone("AA", 0, 0.011), Phone("B", 0.011, 0.05), Phone("S", 0.05, 0.06)], 0, 20, 200)
    assert edges.tolist() == [0, 3, 10, 20]
    assert Durations(np.ones((2, 2)), np.ones((2, 2))).rounded().mean.dtype == np.float64
