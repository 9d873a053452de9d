"""The most likely trajectory under Gaussians of static and dynamic features (Wang 2010, eq. 9-10; Tokuda 1996).

C = (W' U^-1 W)^-1 W' U^-1 mu. The windows of W reach one row to either side, so each coefficient's matrix has two
diagonals below the main one, and a banded Cholesky factorisation solves it in O(R).
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOW = np.array([[0.0, 1.0, 0.0], [-0.5, 0.0, 0.5], [1.0, -2.0, 1.0]])
"""Weights of the row before, the row itself, and the row after, for static, delta and delta-delta."""


def generate(mean: Array, precision: Array) -> Array:
    """The rows C of eq. 10.

    Args:
        mean: (R, 3 K) mu: static, delta, delta-delta of each row.
        precision: (R, 3 K) the diagonal of U^-1; those of static features positive.

    Returns:
        (R, K).
    """
    rows, wide = mean.shape
    solution = np.zeros((rows, wide // 3))
    shape = (rows, 3, wide // 3)
    _generate(
        np.ascontiguousarray(mean).reshape(shape), np.ascontiguousarray(precision).reshape(shape), WINDOW, solution
    )  # fmt: skip
    return solution


@nb.njit(cache=True, nogil=True)
def _generate(mean: Array, precision: Array, window: Array, solution: Array) -> None:
    """Fill `solution` (R, K) with zeros in it; `mean` and `precision` are (R, 3, K).

    A dynamic feature whose window leaves the rows says nothing.
    """
    rows, _, count = mean.shape
    band = np.zeros((rows, 3, count))  # [t, i]: element (t, t - i) of the matrix, then of its Cholesky factor
    for t in range(rows):
        for w in range(3):
            if w > 0 and (t == 0 or t + 1 >= rows):
                continue
            for i in range(3):
                if window[w, i] == 0.0:
                    continue
                row = t + i - 1
                for k in range(count):
                    solution[row, k] += window[w, i] * precision[t, w, k] * mean[t, w, k]
                for j in range(i + 1):
                    weight = window[w, i] * window[w, j]
                    if weight != 0.0:
                        for k in range(count):
                            band[row, i - j, k] += weight * precision[t, w, k]
    for t in range(rows):
        reach = min(2, t)
        for i in range(reach, -1, -1):
            for k in range(count):
                value = band[t, i, k]
                for j in range(i + 1, reach + 1):
                    value -= band[t, j, k] * band[t - i, j - i, k]
                band[t, i, k] = np.sqrt(value) if i == 0 else value / band[t - i, 0, k]
        for k in range(count):
            value = solution[t, k]
            for i in range(1, reach + 1):
                value -= band[t, i, k] * solution[t - i, k]
            solution[t, k] = value / band[t, 0, k]
    for t in range(rows - 1, -1, -1):
        for k in range(count):
            value = solution[t, k]
            for i in range(1, min(2, rows - 1 - t) + 1):
                value -= band[t + i, i, k] * solution[t + i, k]
            solution[t, k] = value / band[t, 0, k]
