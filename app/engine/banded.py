"""Symmetric banded systems of the trajectory equation, solved by Cholesky in O(T) (Fu 2011, 3.3.1 and 4.4).

Fu 2011 builds the T x T matrix and solves it in O(T^2); its half-bandwidth is z, so a banded factorisation needs only
O(T z^2). All coefficients share the smoothness band and differ in their diagonal.
"""

from __future__ import annotations

from functools import lru_cache

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@lru_cache(maxsize=512)
def smoothness_band(frames: int, order: int) -> Array:
    """Lower band of (W'W)^z for first differences W (Fu 2011, eq. 3.1).

    Args:
        frames: T, at least 1.
        order: z.

    Returns:
        Shape (z + 1, T): entry [i, t] is the matrix element (t + i, t); read-only, shared.
    """
    first = np.zeros((2 * order + 1, frames))  # band of the current power, diagonal offset -order..order in row order..
    first[order] = 1.0
    for _ in range(order):
        first = _times_laplacian(first, order)
    band = np.zeros((order + 1, frames))
    for i in range(min(order + 1, frames)):
        band[i, : frames - i] = first[order + i, : frames - i]
    band.setflags(write=False)
    return band


def _times_laplacian(band: Array, order: int) -> Array:
    """(W'W) M for a banded M; row `order + i` of the array holds elements (t + i, t)."""
    frames = band.shape[1]
    result = np.zeros_like(band)
    diagonal = np.full(frames, 2.0)
    diagonal[0] -= 1.0
    diagonal[-1] -= 1.0
    for i in range(-order, order + 1):
        columns = np.arange(max(0, -i), min(frames, frames - i))
        rows = columns + i
        value = diagonal[rows] * band[order + i, columns]
        for step in (-1, 1):
            j = i + step
            if -order <= j <= order:
                inside = (rows + step >= 0) & (rows + step < frames)
                value = value - np.where(inside, band[order + j, columns], 0.0)
        result[order + i, columns] = value
    return result


@nb.njit(cache=True, nogil=True)
def solve(diagonal: Array, band: Array, right: Array, solution: Array) -> None:
    """Solve (diag(d_k) + B) y_k = r_k for every coefficient k by banded Cholesky.

    Args:
        diagonal: (T, K), positive; what each coefficient adds to B's diagonal.
        band: (z + 1, T), lower band of the shared matrix B, as `smoothness_band` gives it.
        right: (T, K).
        solution: (T, K), overwritten.
    """
    frames, count = diagonal.shape
    order = band.shape[0] - 1
    factor = np.zeros((frames, order + 1, count))  # [t, i]: element (t, t - i) of the Cholesky factor
    for t in range(frames):
        reach = min(order, t)
        for i in range(reach, -1, -1):
            for k in range(count):
                value = band[i, t - i]
                if i == 0:
                    value += diagonal[t, k]
                for j in range(i + 1, reach + 1):
                    if j - i <= order:
                        value -= factor[t, j, k] * factor[t - i, j - i, k]
                if i == 0:
                    factor[t, 0, k] = np.sqrt(value)
                else:
                    factor[t, i, k] = value / factor[t - i, 0, k]
        for k in range(count):
            value = right[t, k]
            for i in range(1, reach + 1):
                value -= factor[t, i, k] * solution[t - i, k]
            solution[t, k] = value / factor[t, 0, k]
    for t in range(frames - 1, -1, -1):
        for k in range(count):
            value = solution[t, k]
            for i in range(1, min(order, frames - 1 - t) + 1):
                value -= factor[t + i, i, k] * solution[t + i, k]
            solution[t, k] = value / factor[t, 0, k]
