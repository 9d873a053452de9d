from __future__ import annotations

from itertools import product

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine.selection_search import LOOK_AHEAD, Search, joining_costs, similarities

Float = NDArray[np.float32]


def chain(count: int, breaks: tuple[int, ...] = ()) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Neighbours of samples recorded in a row, with new recordings beginning at `breaks`."""
    numbers = np.arange(count)
    starts = np.isin(numbers, (0, *breaks))
    return np.where(starts, numbers, numbers - 1), np.where(np.append(starts[1:], True), numbers, numbers + 1)


def cost(path: tuple[int, ...], distances: Float, joins: Float, weight: float, start: int | None) -> float:
    """Eq. 11 of one sequence."""
    total = sum(float(distances[frame, number]) for frame, number in enumerate(path))
    before = path[:-1] if start is None else (start, *path[:-1])
    after = path[1:] if start is None else path
    return total + weight * sum(float(joins[p, q]) for p, q in zip(before, after, strict=True))


def test_similarity_is_opencvs_normalised_cross_correlation() -> None:
    random = np.random.default_rng(0)
    pictures = random.uniform(0, 255, (6, 9, 11)).astype(np.float32)
    found = similarities(pictures.reshape(6, -1))
    for p, q in product(range(6), repeat=2):
        expected = cv2.matchTemplate(pictures[p], pictures[q], cv2.TM_CCOEFF_NORMED)[0, 0]
        assert found[p, q] == pytest.approx(expected, abs=1e-5)


def test_similarity_knows_no_light_and_plain_pictures_only_each_other() -> None:
    random = np.random.default_rng(1)
    picture = random.uniform(50, 100, 40).astype(np.float32)
    found = similarities(np.stack([picture, 1.5 * picture + 20, np.full(40, 90), np.full(40, 3)]).astype(np.float32))
    assert found[0, 1] == pytest.approx(1, abs=1e-5)
    assert found[2, 3] == 1
    assert abs(found[0, 2]) < 1e-5


def test_what_was_recorded_in_a_row_joins_for_nothing() -> None:
    images = np.random.default_rng(2).uniform(0, 255, (8, 50)).astype(np.float32)
    before, after = chain(8, breaks=(5,))
    similar = similarities(images)
    joins = joining_costs(similar, before, after)
    for p in range(7):
        assert (joins[p, p + 1] < 1e-6) == (p != 4)
    assert joins[2, 6] == pytest.approx(1 - (similar[2, 5] + similar[3, 6]) / 2, abs=1e-6)  # eq. 14
    assert joins[4, 5] == pytest.approx(1 - similar[4, 5], abs=1e-6)  # neither has a neighbour: how alike they are
    assert (joins >= 0).all()


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 5), st.floats(0, 5), st.booleans())
def test_the_path_is_the_cheapest_of_all(seed: int, frames: int, samples: int, weight: float, started: bool) -> None:
    random = np.random.default_rng(seed)
    distances = random.uniform(0, 1, (frames, samples)).astype(np.float32)
    joins = random.uniform(0, 1, (samples, samples)).astype(np.float32)
    start = int(random.integers(samples)) if started else None
    found = tuple(Search(joins, weight).path(distances, start).tolist())
    least = min(cost(path, distances, joins, weight, start) for path in product(range(samples), repeat=frames))
    assert cost(found, distances, joins, weight, start) == pytest.approx(least, abs=1e-4)


def test_only_the_nearest_and_of_them_the_best_joined_are_looked_at() -> None:
    distances = np.array([[0.0, 9, 9, 9], [0.2, 0.1, 0.3, 0.0]], np.float32)
    joins = np.ones((4, 4), np.float32)
    joins[0] = [0.5, 0.4, 0.0, 0.9]
    assert Search(joins, 1.0).path(distances).tolist() == [0, 2]  # 0.3
    assert Search(joins, 1.0, nearest=2).path(distances).tolist() == [0, 1]  # 2 is not among the nearest two
    assert Search(joins, 0.0).path(distances).tolist() == [0, 3]
    assert Search(joins, 0.0, kept=2).path(distances).tolist() == [0, 1]  # of 2 and 1, that join best, the nearer


def test_pruning_costs_little() -> None:
    random = np.random.default_rng(3)
    places = np.cumsum(random.normal(0, 1, (300, 4)), 0).astype(np.float32)
    wanted = places[100:160] + random.normal(0, 0.5, (60, 4)).astype(np.float32)
    distances = np.linalg.norm(wanted[:, None] - places, axis=2).astype(np.float32)
    joins = joining_costs(similarities(places @ random.normal(0, 1, (4, 30)).astype(np.float32)), *chain(300))
    pruned, whole = (Search(joins, 3.0, nearest=k, kept=k // 2).path(distances) for k in (40, 600))
    costs = [cost(tuple(path.tolist()), distances, joins, 3.0, None) for path in (pruned, whole)]
    assert costs[1] - 1e-3 <= costs[0] < 1.1 * costs[1]


def test_the_beginning_does_not_depend_on_what_comes_much_later() -> None:
    random = np.random.default_rng(4)
    distances = random.uniform(0, 1, (4 * LOOK_AHEAD, 30)).astype(np.float32)
    joins = random.uniform(0, 1, (30, 30)).astype(np.float32)
    search = Search(joins, 1.0)
    whole, shorter = search.path(distances), search.path(distances[: 2 * LOOK_AHEAD])
    assert np.array_equal(whole[:LOOK_AHEAD], shorter[:LOOK_AHEAD])
    again = search.path(distances[LOOK_AHEAD:], int(whole[LOOK_AHEAD - 1]))
    assert np.array_equal(again, whole[LOOK_AHEAD:])  # a piece that follows goes on where the one before would have


def test_nothing_to_show_is_nothing() -> None:
    assert len(Search(np.zeros((3, 3), np.float32), 1.0).path(np.zeros((0, 3), np.float32), 1)) == 0
