from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import approx_fprime

from app.engine.models.gpdm_process import Kernel, Posterior, covariance, inverse, slope

Array = NDArray[np.float64]
KERNEL = Kernel(radial=0.7, inverse_width=0.4, linear=0.2, noise=0.05)


def between(a: Array, b: Array) -> float:
    """The kernel of two points, to the letter."""
    return float(0.7 * np.exp(-0.4 / 2 * np.linalg.norm(a - b) ** 2) + 0.2 * a @ b)


@pytest.fixture
def points() -> Array:
    return np.random.default_rng(1).standard_normal((7, 3))


@pytest.fixture
def outputs() -> Array:
    return np.random.default_rng(2).standard_normal((7, 4))


def dense(points: Array) -> Array:
    return np.array([[between(a, b) for b in points] for a in points]) + 0.05 * np.eye(len(points))


def test_the_covariance_is_the_kernel_of_every_pair(points: Array) -> None:
    np.testing.assert_allclose(covariance(KERNEL, points)[0], dense(points), atol=1e-12)


def test_inverse_and_determinant(points: Array) -> None:
    matrix = dense(points)
    found, determinant = inverse(matrix)
    np.testing.assert_allclose(found @ matrix, np.eye(7), atol=1e-10)
    assert determinant == pytest.approx(np.linalg.slogdet(matrix)[1])
    with pytest.raises(np.linalg.LinAlgError):
        inverse(-matrix)


def test_the_posterior_is_that_of_a_dense_process(points: Array, outputs: Array) -> None:
    new = np.random.default_rng(3).standard_normal((5, 3))
    said = Posterior.of(KERNEL, points, outputs).at(new)
    across = np.array([[between(a, b) for b in points] for a in new])
    solved = np.linalg.solve(dense(points), across.T)
    np.testing.assert_allclose(said.mean, solved.T @ outputs, atol=1e-10)
    np.testing.assert_allclose(Posterior.of(KERNEL, points, outputs).mean(new), said.mean)
    own = np.array([between(a, a) for a in new]) + 0.05
    np.testing.assert_allclose(said.variance, own - (across.T * solved).sum(0), atol=1e-10)


def test_gradients_by_the_points_that_are_asked(points: Array, outputs: Array) -> None:
    rng = np.random.default_rng(4)
    posterior = Posterior.of(KERNEL, points, outputs)
    by_mean, by_variance, new = rng.standard_normal((2, 4)), rng.standard_normal(2), rng.standard_normal((2, 3))

    def value(flat: Array) -> float:
        said = posterior.at(flat.reshape(2, 3))
        return float((said.mean * by_mean).sum() + said.variance @ by_variance)

    found = posterior.at(new).back(by_mean, by_variance).ravel()
    np.testing.assert_allclose(found, approx_fprime(new.ravel(), value, 1e-7), atol=1e-5)


def test_gradients_through_the_covariance(points: Array) -> None:
    by = np.random.default_rng(5).standard_normal((7, 7))
    by = by + by.T

    def value(variables: Array) -> float:
        return float((covariance(Kernel(*np.exp(variables[-4:])), variables[:-4].reshape(7, 3))[0] * by).sum())

    found = slope(KERNEL, points, covariance(KERNEL, points)[1], by)
    numeric = approx_fprime(np.concatenate([points.ravel(), np.log(KERNEL)]), value, 1e-7)
    np.testing.assert_allclose(np.concatenate([found.points.ravel(), found.kernel]), numeric, atol=1e-4)
