from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import approx_fprime
from scipy.stats import multivariate_normal, norm

from app.engine.models.gpdm_process import Kernel, covariance
from app.engine.models.gpdm_training import (
    DYNAMICS,
    FIRST,
    LATENT,
    LOOSENESS,
    PRIOR_FRAMES,
    Likelihood,
    best_scale,
    principal_points,
    train,
)

Array = NDArray[np.float64]
FRAMES = 9
BEGINS = np.array([0, 4])


@pytest.fixture
def likelihood() -> Likelihood:
    """Two sequences, of four frames and of five."""
    rng = np.random.default_rng(0)
    after = np.setdiff1d(np.arange(FRAMES), BEGINS)
    return Likelihood(rng.standard_normal((FRAMES, 5)), rng.standard_normal((FRAMES, 7)), after - 1, after, BEGINS)


def variables(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.standard_normal(FRAMES * LATENT), np.log(FIRST), np.log(FIRST)]) + 0.3 * np.append(
        np.zeros(FRAMES * LATENT), rng.standard_normal(8)
    )


def literal(likelihood: Likelihood, at: Array) -> float:
    """-log of eq. 4 with its priors, every density by scipy."""
    points = at[:-8].reshape(FRAMES, LATENT)
    total = 0.0
    for own, outputs in ((at[-8:-4], likelihood.sound), (at[-4:], likelihood.sight)):
        kernel = Kernel(*np.exp(own))
        whole = covariance(kernel, points)[0]
        scale = best_scale(kernel, points, outputs)
        for column, weight in zip(outputs.T, scale, strict=True):
            total -= multivariate_normal.logpdf(column, cov=whole / weight**2)
            total -= PRIOR_FRAMES * (np.log(weight) - weight**2 / 2)
        total -= norm.logpdf(own, np.log(FIRST), LOOSENESS).sum()
    total -= norm.logpdf(points[likelihood.first]).sum()
    whole = covariance(DYNAMICS, points[likelihood.before])[0]
    return total - sum(multivariate_normal.logpdf(column, cov=whole) for column in points[likelihood.after].T)


def test_it_is_equation_4_but_for_a_constant(likelihood: Likelihood) -> None:
    one, other = variables(1), variables(2)
    difference = likelihood(one)[0] - likelihood(other)[0]
    assert difference == pytest.approx(literal(likelihood, one) - literal(likelihood, other))


def test_its_gradient_is_that_of_finite_differences(likelihood: Likelihood) -> None:
    at = variables(3)
    numeric = approx_fprime(at, lambda x: likelihood(x)[0], 1e-7)
    np.testing.assert_allclose(likelihood(at)[1], numeric, atol=2e-4)


def test_a_kernel_out_of_range_has_no_likelihood(likelihood: Likelihood) -> None:
    at = variables(3)
    at[-1] = 30
    with pytest.raises(np.linalg.LinAlgError):
        likelihood(at)


def test_the_scale_is_the_most_probable(likelihood: Likelihood) -> None:
    at = variables(4)
    points, outputs = at[:-8].reshape(FRAMES, LATENT), likelihood.sound
    best = best_scale(FIRST, points, outputs)
    whole = covariance(FIRST, points)[0]

    def probability(weight: float) -> float:
        there = multivariate_normal.logpdf(outputs[:, 0], cov=whole / weight**2)
        return float(there + PRIOR_FRAMES * (np.log(weight) - weight**2 / 2))

    assert probability(best[0]) > max(probability(best[0] * 0.98), probability(best[0] * 1.02))


def test_points_begin_at_principal_components() -> None:
    """Where sound and sight are the same, they are its components, decorrelated and of one variance."""
    rows = np.random.default_rng(5).standard_normal((40, 8)) * np.arange(8, 0, -1)
    rows -= rows.mean(0)
    points = principal_points(rows, -rows, rng=np.random.default_rng(0))
    np.testing.assert_allclose(points.T @ points / 40, np.eye(LATENT), atol=0.01)
    axes = np.linalg.svd(rows, full_matrices=False)[2][:LATENT]
    related = np.corrcoef(points.T, (rows @ axes.T).T)[:LATENT, LATENT:]
    np.testing.assert_allclose(np.abs(related), np.eye(LATENT), atol=0.01)


def test_training_makes_frames_more_likely_and_repeats(likelihood: Likelihood) -> None:
    start = principal_points(likelihood.sound, likelihood.sight, rng=np.random.default_rng(7))
    begun = likelihood(np.concatenate([start.ravel(), np.log(FIRST), np.log(FIRST)]))[0]
    found, again = (train(likelihood, steps=15, rng=np.random.default_rng(7)) for _ in range(2))
    assert found.cost < begun - 1
    assert np.array_equal(found.points, again.points)
