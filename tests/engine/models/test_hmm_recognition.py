from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm
from test_hmm_stream import material

from app.engine.models.hmm_context import QUIET
from app.engine.models.hmm_recognition import BELIEF, SHARPNESS, Loop, phone_grammar, row_likelihoods
from app.engine.models.hmm_states import MOST, even_durations, slots_of
from app.engine.models.hmm_stream import Stream, gathered, grown, tied
from app.speech import PHONES

Array = NDArray[np.float64]
PLACES = np.array([PHONES.index(symbol) for symbol in ("AA", "B", "SIL")])


@pytest.fixture(scope="module")
def stream() -> Stream:
    found = gathered(*material(3))
    return tied(found, grown(found, penalty=0.3))


def grammar(seed: int = 0) -> Array:
    made = np.log(np.random.default_rng(seed).dirichlet(np.ones(3), (3, 3)))
    made[:, 2, 2] = -1e9
    return made


def best_by_trying(stream: Stream, fits: Array, words: Array) -> float:
    """Log likelihood of the best way through all phones and states, each tried."""
    durations = even_durations()
    rows, found = len(fits), -np.inf
    every = np.array([PLACES[list(each)] for each in np.ndindex(3, 3, 3)], np.int16)
    leaves, (firsts, counts) = stream.leaves(every), slots_of(every)

    def walk(t: int, l: int, c: int, r: int, state: int, score: float) -> None:  # noqa: E741
        nonlocal found
        context = 9 * l + 3 * c + r
        score += fits[t, leaves[context, state]]
        if t + 1 == rows:
            found = max(found, score)
            return
        lasting = max(durations.mean[PLACES[c], firsts[context] + state], 1.01)
        walk(t + 1, l, c, r, state, score + np.log(1 - 1 / lasting))
        score += np.log(1 / lasting)
        if state + 1 < counts[context]:
            walk(t + 1, l, c, r, state + 1, score)
        else:
            for following in range(3):
                walk(t + 1, c, r, following, 0, score + words[l, c, r])

    for l, c, r in np.ndindex(3, 3, 3):  # noqa: E741
        walk(0, l, c, r, 0, 0.0)
    return found


def likelihood_of(loop: Loop, fits: Array, said: Array, begins: Array, words: Array) -> float:
    """The best that the phones found allow, whatever came before the first and after the last."""
    number = {int(place): at for at, place in enumerate(PLACES)}
    spoken = [number[int(place)] for place in said]
    best = -np.inf
    for before, after in np.ndindex(3, 3):
        whole = [before, *spoken, after]
        total = 0.0
        for at in range(1, len(whole) - 1):
            l, c, r = whole[at - 1 : at + 2]  # noqa: E741
            node = loop.nodes[l, c, r]
            count = loop.counts[node]
            span = range(int(begins[at - 1]), int(begins[at]))
            scores = np.full(MOST, -np.inf)
            for t in span:
                come = np.append(-np.inf, scores[:-1] + loop.leave[node, :-1])
                scores = np.maximum(scores + loop.stay[node], come) if t > span[0] else np.eye(MOST)[0] * 1e9 - 1e9
                scores = np.where(np.arange(MOST) < count, scores + fits[t, loop.leaves[node]], -np.inf)
            ended = at < len(whole) - 2
            total += scores[count - 1] + loop.leave[node, count - 1] + words[l, c, r] if ended else scores.max()
        best = max(best, total)
    return best


@pytest.mark.parametrize("seed", range(4))
def test_no_other_phones_are_likelier(stream: Stream, seed: int) -> None:
    random = np.random.default_rng(seed)
    fits = 4 * random.standard_normal((8, len(stream.mean)))
    words = grammar(seed)
    loop = Loop.of(stream, even_durations(), PLACES, words)
    said, begins = loop.recognise(fits, beam=np.inf)
    assert begins[0] == 0
    assert begins[-1] == 8
    expected = best_by_trying(stream, fits * SHARPNESS, words)
    assert likelihood_of(loop, fits * SHARPNESS, said, begins, words) == pytest.approx(expected)


def test_a_beam_that_is_wide_finds_the_same(stream: Stream) -> None:
    fits = 10 * np.random.default_rng(5).standard_normal((60, len(stream.mean)))
    loop = Loop.of(stream, even_durations(), PLACES, grammar())
    exact, wide = (loop.recognise(fits, beam=beam) for beam in (np.inf, 40.0))
    assert all(np.array_equal(a, b) for a, b in zip(exact, wide, strict=True))


def test_nodes_stand_for_contexts_with_the_same_states(stream: Stream) -> None:
    loop = Loop.of(stream, even_durations(), PLACES, grammar())
    for l, c, r in np.ndindex(3, 3, 3):  # noqa: E741
        context = PLACES[[l, c, r]][None].astype(np.int16)
        node = loop.nodes[l, c, r]
        assert np.array_equal(loop.leaves[node], stream.leaves(context)[0])
        assert loop.counts[node] == slots_of(context)[1][0]
        assert loop.pairs[node] == 3 * l + c


def test_rows_are_as_likely_as_their_densities_say(stream: Stream) -> None:
    rows = np.random.default_rng(2).standard_normal((4, 2))
    found = row_likelihoods(stream, rows)
    exact = np.array([norm.logpdf(row, stream.mean, np.sqrt(stream.variance)).sum(1) for row in rows])
    np.testing.assert_allclose(np.diff(found, axis=1), np.diff(exact, axis=1), atol=1e-8)


def test_a_grammar_counts_and_backs_off() -> None:
    aa, b = PLACES[0], PLACES[1]
    said = np.array([[QUIET, aa, b], [aa, b, aa], [QUIET, aa, b], [QUIET, aa, QUIET]])
    likely = np.exp(phone_grammar(said, PLACES))
    np.testing.assert_allclose(likely.sum(-1), 1, atol=1e-6)
    assert likely[:, 2, 2].max() < 1e-20
    # By hand: one (b: 2, aa: 1, silence: 1), then what follows aa (b: 2, silence: 1), then the same after silence.
    one = (np.array([1, 2, 1]) + 0.5) / (4 + 1.5)
    two = 3 / (3 + 2 * BELIEF) * np.array([0, 2, 1]) / 3 + 2 * BELIEF / (3 + 2 * BELIEF) * one
    three = 3 / (3 + 2 * BELIEF) * np.array([0, 2, 1]) / 3 + 2 * BELIEF / (3 + 2 * BELIEF) * two
    np.testing.assert_allclose(likely[2, 0], three, rtol=1e-5)
    np.testing.assert_allclose(likely[1, 0], two, rtol=1e-5)
