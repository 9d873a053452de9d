from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine.models.hmm_generation import generate

Array = NDArray[np.float64]


def literal(mean: Array, precision: Array) -> Array:
    """Eq. 9 and 10 with whole matrices, one coefficient after the other."""
    rows, count = len(mean), mean.shape[1] // 3
    inner = np.arange(1, rows - 1)
    delta, second = np.zeros((rows, rows)), np.zeros((rows, rows))
    delta[inner, inner + 1], delta[inner, inner - 1] = 0.5, -0.5
    second[inner, inner + 1], second[inner, inner], second[inner, inner - 1] = 1.0, -2.0, 1.0
    windows = np.concatenate([np.eye(rows), delta, second])
    found = np.zeros((rows, count))
    for k in range(count):
        inverse = np.diag(np.concatenate([precision[:, w * count + k] for w in range(3)]))
        target = np.concatenate([mean[:, w * count + k] for w in range(3)])
        found[:, k] = np.linalg.solve(windows.T @ inverse @ windows, windows.T @ inverse @ target)
    return found


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 14), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_it_is_the_literal_solution(rows: int, count: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    mean = random.standard_normal((rows, 3 * count))
    precision = np.exp(2 * random.standard_normal((rows, 3 * count)))
    np.testing.assert_allclose(generate(mean, precision), literal(mean, precision), atol=1e-7)


def test_the_most_likely_rows_cannot_be_bettered() -> None:
    random = np.random.default_rng(3)
    mean, precision = random.standard_normal((9, 3)), np.exp(random.standard_normal((9, 3)))

    def cost(rows: Array) -> float:
        """What eq. 6 leaves of the likelihood, written out."""
        total = float((precision[:, 0] * (rows - mean[:, 0]) ** 2).sum())
        for t in range(1, 8):
            total += precision[t, 1] * ((rows[t + 1] - rows[t - 1]) / 2 - mean[t, 1]) ** 2
            total += precision[t, 2] * (rows[t + 1] - 2 * rows[t] + rows[t - 1] - mean[t, 2]) ** 2
        return total

    best = generate(mean, precision)[:, 0]
    for _ in range(200):
        assert cost(best) < cost(best + 0.01 * random.standard_normal(9))


def test_no_rows_are_none() -> None:
    assert generate(np.zeros((0, 6)), np.zeros((0, 6))).shape == (0, 2)


@pytest.mark.parametrize("weight", [1e-6, 1e6])
def test_weak_dynamics_follow_the_targets_and_strong_ones_smooth(weight: float) -> None:
    mean = np.zeros((40, 3))
    mean[20:, 0] = 1.0
    precision = np.ones_like(mean)
    precision[:, 1:] = weight
    step = np.abs(np.diff(generate(mean, precision)[:, 0])).max()
    assert step > 0.99 if weight < 1 else step < 0.1
