from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import norm

from app.engine.models.hmm_tree import Statistics, Tree, best_split, grow

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
FLOOR = np.full(2, 1e-4)


def case(seed: int, contexts: int = 12, asked: int = 6) -> tuple[list[Array], Flags]:
    """Rows (n, 2) of each context, and answers; what is seen hangs together with the first answers."""
    random = np.random.default_rng(seed)
    answers = random.random((asked, contexts)) < 0.5
    place = 3.0 * answers[0] + 1.5 * (answers[0] & answers[1])
    return [random.normal(place[at], 1.0, (random.integers(2, 9), 2)) for at in range(contexts)], answers


def statistics(rows: list[Array]) -> Statistics:
    return Statistics(
        np.array([len(each) for each in rows], float), np.array([each.sum(0) for each in rows]),
        np.array([(each**2).sum(0) for each in rows]),
    )  # fmt: skip


def likelihood(rows: list[Array]) -> float:
    """Of rows under the Gaussian that fits them best, by the density itself."""
    whole = np.concatenate(rows)
    return float(norm.logpdf(whole, whole.mean(0), np.sqrt(np.maximum(whole.var(0), FLOOR))).sum())


def gain_of(rows: list[Array], yes: Flags) -> float:
    sides = [[each for each, chosen in zip(rows, side, strict=True) if chosen] for side in (yes, ~yes)]
    return sum(likelihood(side) for side in sides) - likelihood(rows)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_the_best_split_gains_what_the_densities_say(seed: int) -> None:
    rows, answers = case(seed)
    count = np.array([len(each) for each in rows])
    gains = [
        gain_of(rows, yes) if min(count[yes].sum(), count[~yes].sum()) >= 8 else -np.inf for yes in answers
    ]  # fmt: skip
    best, gain = best_split(statistics(rows), answers, FLOOR, 8)
    assert best == int(np.argmax(gains)) or gains[best] == pytest.approx(max(gains))
    assert gain == pytest.approx(max(gains), rel=1e-8, abs=1e-8)


def test_sides_with_too_little_are_no_sides() -> None:
    rows, answers = case(0)
    assert best_split(statistics(rows), answers, FLOOR, 1e6) == (-1, 0.0)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2))
def test_a_tree_cut_back_is_the_tree_grown_less(seed: int, penalty: float) -> None:
    rows, answers = case(seed, contexts=40)
    large = grow(statistics(rows), answers, FLOOR, penalty=0.01, least=4)
    small = grow(statistics(rows), answers, FLOOR, penalty=penalty, least=4)
    cut = large.cut(penalty)
    assert cut.leaves == small.leaves <= large.leaves
    for part in ("question", "yes", "no"):
        assert np.array_equal(getattr(cut, part), getattr(small, part))


def test_description_length_finds_what_is_there_and_no_more() -> None:
    random = np.random.default_rng(1)
    answers = random.random((30, 200)) < 0.5
    rows = [random.normal(4.0 * answers[7, at], 1.0, (10, 2)) for at in range(200)]
    tree = grow(statistics(rows), answers, FLOOR, penalty=1.0, least=4)
    assert tree.question.tolist() == [7, -1, -1]
    assert np.array_equal(tree.leaf(answers), np.where(answers[7], 0, 1))


def test_contexts_fall_where_their_answers_lead() -> None:
    rows, answers = case(5, contexts=60)
    tree = grow(statistics(rows), answers, FLOOR, penalty=0.02, least=4)
    assert tree.leaves > 2
    for at, leaf in enumerate(tree.leaf(answers)):
        node = 0
        while tree.question[node] >= 0:
            node = int((tree.yes if answers[tree.question[node], at] else tree.no)[node])
        assert tree.leaf_numbers()[node] == leaf


@pytest.mark.parametrize(
    ("question", "yes", "no", "sound"),
    [
        ([-1], [-1], [-1], True),
        ([2, -1, -1], [1, -1, -1], [2, -1, -1], True),
        ([3, -1, -1], [1, -1, -1], [2, -1, -1], False),  # a question that there is not
        ([2, -1, -1], [0, -1, -1], [2, -1, -1], False),  # a walk without end
        ([2, -1, -1], [1, -1, -1], [3, -1, -1], False),  # out of the tree
        ([], [], [], False),
    ],
)
def test_trees_that_lead_nowhere_are_not_sound(question: list[int], yes: list[int], no: list[int], sound: bool) -> None:
    arrays = (np.array(each, np.int64) for each in (question, yes, no))
    assert Tree(*arrays, np.zeros(len(question))).is_sound(3) is sound
