"""Least squares with weights on the simplex: beta >= 0, sum beta = 1 (Ezzat 2002)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def project_to_simplex(points: Array) -> Array:
    """Nearest point of the simplex for each row of (n, N), in the Euclidean sense."""
    count = points.shape[1]
    ordered = -np.sort(-points, axis=1)
    excess = np.cumsum(ordered, axis=1) - 1
    position = np.arange(1, count + 1)
    active = (ordered - excess / position > 0).sum(axis=1)
    threshold = excess[np.arange(len(points)), active - 1] / active
    nearest: Array = np.maximum(points - threshold[:, None], 0)
    return nearest


def least_squares_on_simplex(gram: Array, linear: Array, *, iterations: int = 400) -> Array:
    """Minimise b' G b / 2 - l' b over the simplex for each row l of `linear`, by accelerated projected gradient.

    Args:
        gram: (N, N) symmetric, G = A A' for prototypes A.
        linear: (n, N), A x for targets x.

    Returns:
        (n, N) weights.
    """
    count = len(gram)
    step = 1 / max(float(np.linalg.eigvalsh(gram)[-1]), 1e-12)
    weights = np.full(linear.shape, 1 / count)
    ahead, momentum = weights, 1.0
    for _ in range(iterations):
        moved = project_to_simplex(ahead - step * (ahead @ gram - linear))
        following = (1 + np.sqrt(1 + 4 * momentum * momentum)) / 2
        ahead = moved + (momentum - 1) / following * (moved - weights)
        weights, momentum = moved, following
    return weights
