from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from app.engine.simplex import least_squares_on_simplex, project_to_simplex


@given(st.integers(1, 12), st.integers(0, 2**32 - 1), st.floats(0.01, 100))
@settings(max_examples=60, deadline=None)
def test_projections_are_on_the_simplex_and_stay_there(count: int, seed: int, size: float) -> None:
    points = np.random.default_rng(seed).standard_normal((7, count)) * size
    nearest = project_to_simplex(points)
    assert (nearest >= 0).all()
    np.testing.assert_allclose(nearest.sum(1), 1, atol=1e-9)
    np.testing.assert_allclose(project_to_simplex(nearest), nearest, atol=1e-9)


@given(st.integers(2, 8), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_nothing_on_the_simplex_is_nearer_than_the_projection(count: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    points = random.standard_normal((5, count)) * 2
    nearest = project_to_simplex(points)
    others = np.concatenate([random.dirichlet(np.ones(count), 50), np.eye(count)])
    # The projection's defining inequality: (point - nearest) . (other - nearest) <= 0 for all of a convex set.
    inner = np.einsum("nk,nmk->nm", points - nearest, others[None] - nearest[:, None])
    assert inner.max() < 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_the_weights_are_those_of_a_general_solver(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(2, 7))
    prototypes = random.standard_normal((count, 10))
    target = random.standard_normal(10) + prototypes[0]
    found = least_squares_on_simplex(prototypes @ prototypes.T, prototypes @ target)

    def error(weights: np.ndarray) -> float:
        return 0.5 * float(((weights @ prototypes - target) ** 2).sum())

    expected = minimize(
        error,
        np.full(count, 1 / count),
        jac=lambda weights: prototypes @ (weights @ prototypes - target),
        method="SLSQP",
        bounds=[(0, 1)] * count,
        constraints={"type": "eq", "fun": lambda weights: weights.sum() - 1, "jac": lambda w: np.ones_like(w)},
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert expected.success
    np.testing.assert_allclose(found.sum(), 1, atol=1e-9)
    assert (found >= 0).all()
    np.testing.assert_allclose(found, expected.x, atol=1e-5)
    assert error(found) <= error(expected.x) + 1e-9


def test_a_target_inside_is_met_and_one_at_a_corner_has_one_weight() -> None:
    prototypes = np.random.default_rng(1).standard_normal((4, 9))
    weights = np.array([[0.1, 0.2, 0.3, 0.4], [0, 0, 1, 0]])
    gram, linear = prototypes @ prototypes.T, weights @ prototypes @ prototypes.T
    for row, expected in zip(linear, weights, strict=True):
        np.testing.assert_allclose(least_squares_on_simplex(gram, row), expected, atol=1e-6)


def test_prototypes_without_any_difference_share_the_weight() -> None:
    np.testing.assert_allclose(least_squares_on_simplex(np.zeros((4, 4)), np.zeros(4)), 0.25)


def descended(gram: np.ndarray, linear: np.ndarray, steps: int = 20_000) -> np.ndarray:
    """The same minimum by plain projected gradient descent."""
    weights = np.full((1, len(gram)), 1 / len(gram))
    length = 1 / np.linalg.eigvalsh(gram)[-1]
    for _ in range(steps):
        weights = project_to_simplex(weights - length * (weights @ gram - linear))
    return weights[0]


def test_the_minimum_is_what_descent_goes_towards() -> None:
    random = np.random.default_rng(4)
    prototypes = random.standard_normal((6, 40))
    gram = prototypes @ prototypes.T
    for target in random.standard_normal((5, 40)):
        linear = prototypes @ target
        exact = least_squares_on_simplex(gram, linear)
        assert exact.min() >= 0
        assert exact.sum() == pytest.approx(1)
        assert exact == pytest.approx(descended(gram, linear), abs=1e-5)


def test_the_minimum_finds_a_blend_again() -> None:
    prototypes = np.random.default_rng(5).uniform(0, 255, (46, 500))
    blend = np.zeros(46)
    blend[[3, 20]] = 0.3, 0.7
    assert least_squares_on_simplex(prototypes @ prototypes.T, prototypes @ (blend @ prototypes)) == pytest.approx(
        blend, abs=1e-4
    )
