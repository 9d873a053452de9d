from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import rosen, rosen_der

from app.engine.models.gpdm_optimiser import minimise

Array = NDArray[np.float64]


def test_a_curved_valley_is_followed_to_its_end() -> None:
    point, value = minimise(lambda x: (float(rosen(x)), rosen_der(x)), np.array([-1.2, 1.0, 0.5]), steps=500)
    np.testing.assert_allclose(point, 1.0, atol=1e-3)
    assert value == pytest.approx(0, abs=1e-6)


def test_a_quadratic_is_solved() -> None:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((8, 8))
    matrix, right = root @ root.T + np.eye(8), rng.standard_normal(8)
    point, _ = minimise(
        lambda x: (float(0.5 * x @ matrix @ x - right @ x), matrix @ x - right), np.zeros(8), steps=100, enough=1e-10
    )
    np.testing.assert_allclose(point, np.linalg.solve(matrix, right), atol=1e-4)


@pytest.mark.parametrize("steps", [0, 1, 3, 10])
def test_it_never_goes_up(steps: int) -> None:
    start = np.array([2.0, -3.0])
    point, value = minimise(lambda x: (float(rosen(x)), rosen_der(x)), start, steps=steps)
    assert value <= rosen(start)
    assert value == pytest.approx(rosen(point))


def test_where_there_is_no_value_it_turns_back() -> None:
    """Minus the logarithm of x, plus x: no value at 0 and below."""

    def objective(x: Array) -> tuple[float, Array]:
        if x[0] <= 0:
            raise np.linalg.LinAlgError("outside")
        return float(x[0] - np.log(x[0])), 1 - 1 / x

    point, _ = minimise(objective, np.array([20.0]), steps=200, enough=1e-9)
    assert point[0] == pytest.approx(1, abs=1e-3)
