"""Gaussian processes from points of a latent space: radial basis function plus linear kernel plus noise (eq. 6).

Deena 2010's eq. 6 has the radial basis function alone; the linear part keeps predictions sensible away from the data,
as Wang, Fleet and Hertzmann (2008) have it in the dynamics of their model, on which Deena's builds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Kernel(NamedTuple):
    """k(x, x') = radial exp(-inverse_width |x - x'|^2 / 2) + linear x . x', and noise on the diagonal.

    Attributes:
        radial: alpha of eq. 6, a variance.
        inverse_width: gamma of eq. 6.
        linear: variance of the linear part.
        noise: 1 / beta, a variance.
    """

    radial: float
    inverse_width: float
    linear: float
    noise: float


def radial_part(kernel: Kernel, a: Array, b: Array) -> Array:
    """(n, m) of the radial basis function between points (n, q) and (m, q)."""
    squares = (a * a).sum(1)[:, None] + (b * b).sum(1) - 2.0 * (a @ b.T)
    exponent = np.maximum(squares, 0.0)
    exponent *= -0.5 * kernel.inverse_width
    result: Array = np.exp(exponent, out=exponent)
    result *= kernel.radial
    return result


def inverse(matrix: Array) -> tuple[Array, float]:
    """Inverse and log determinant of a symmetric positive definite matrix (n, n), by Cholesky.

    By numpy alone: scipy brings a BLAS of its own, whose threads cost more than such small matrices take.

    Raises:
        numpy.linalg.LinAlgError: it is not positive definite.
    """
    factor = np.linalg.cholesky(matrix)
    half = np.linalg.inv(factor)
    return half.T @ half, 2.0 * float(np.log(np.diag(factor)).sum())


def covariance(kernel: Kernel, points: Array) -> tuple[Array, Array]:
    """K of eq. 5 or 7 (n, n), with its noise, and its radial part."""
    radial = radial_part(kernel, points, points)
    whole = radial + kernel.linear * (points @ points.T)
    whole[np.diag_indices_from(whole)] += kernel.noise
    return whole, radial


class Slope(NamedTuple):
    """What a gradient by K means for what K is made from."""

    points: Array
    kernel: Array


def slope(kernel: Kernel, points: Array, radial: Array, by: Array) -> Slope:
    """Chain rule through `covariance`.

    Args:
        kernel, points: of K.
        radial: its radial part.
        by: (n, n) symmetric, derivative by every element of K.

    Returns:
        Derivatives by the points (n, q), and by the logarithms of the kernel's four numbers.
    """
    weighted = by * radial
    total = weighted.sum(1)
    pulled = total[:, None] * points - weighted @ points
    inner = by @ points
    moved = -2.0 * kernel.inverse_width * pulled + 2.0 * kernel.linear * inner
    # sum_ij w_ij |x_i - x_j|^2 = 2 sum_i x_i . (total_i x_i - (w x)_i)
    spread = 2.0 * float((points * pulled).sum())
    logarithms = np.array([
        float(total.sum()), -0.5 * kernel.inverse_width * spread, kernel.linear * float((points * inner).sum()),
        kernel.noise * float(np.trace(by)),
    ])  # fmt: skip
    return Slope(moved, logarithms)


@dataclass(frozen=True)
class Posterior:
    """A trained process, ready to predict.

    Attributes:
        kernel: of it.
        points: (n, q) where the outputs are known.
        weights: (n, D) K^-1 times the outputs.
        precision: (n, n) K^-1.
    """

    kernel: Kernel
    points: Array
    weights: Array
    precision: Array

    @staticmethod
    def of(kernel: Kernel, points: Array, outputs: Array) -> Posterior:
        """From points (n, q) and outputs (n, D)."""
        precision, _ = inverse(covariance(kernel, points)[0])
        return Posterior(kernel, points, precision @ outputs, precision)

    def mean(self, at: Array) -> Array:
        """(m, D) mean of the outputs at points (m, q): eq. 14."""
        return self._between(at)[0] @ self.weights

    def at(self, at: Array) -> Predicted:
        """Mean, variance, and what their gradients need."""
        across, radial = self._between(at)
        solved = across @ self.precision
        kernel = self.kernel
        own = kernel.radial + kernel.linear * (at * at).sum(1) + kernel.noise
        variance = np.maximum(own - (solved * across).sum(1), kernel.noise)
        return Predicted(self, at, across @ self.weights, variance, radial, solved)

    def _between(self, at: Array) -> tuple[Array, Array]:
        radial = radial_part(self.kernel, at, self.points)
        return radial + self.kernel.linear * (at @ self.points.T), radial


@dataclass(frozen=True)
class Predicted:
    """What a process says at some points.

    Attributes:
        posterior, points: of what, and where.
        mean: (m, D).
        variance: (m,) of every output, with noise.
    """

    posterior: Posterior
    points: Array
    mean: Array
    variance: Array
    radial: Array
    solved: Array

    def back(self, by_mean: Array, by_variance: Array) -> Array:
        """Derivative by the points (m, q) from those by mean (m, D) and variance (m,)."""
        posterior, kernel = self.posterior, self.posterior.kernel
        by = by_mean @ posterior.weights.T - 2.0 * by_variance[:, None] * self.solved
        weighted = by * self.radial
        pulled = weighted.sum(1)[:, None] * self.points - weighted @ posterior.points
        own = 2.0 * kernel.linear * by_variance[:, None] * self.points
        result: Array = kernel.linear * (by @ posterior.points) - kernel.inverse_width * pulled + own
        return result
