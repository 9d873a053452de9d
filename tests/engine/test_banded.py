from __future__ import annotations

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine import banded
from app.engine.banded import smoothness_band, solve

Array = NDArray[np.float64]


def dense_smoothness(frames: int, order: int) -> Array:
    """(W'W)^z with W as printed in Fu 2011, 3.3.1: each row takes a frame from the next."""
    differences = np.zeros((frames - 1, frames))
    differences[np.arange(frames - 1), np.arange(frames - 1)] = -1
    differences[np.arange(frames - 1), np.arange(1, frames)] = 1
    return np.linalg.matrix_power(differences.T @ differences, order)


def unpacked(band: Array) -> Array:
    frames = band.shape[1]
    matrix = np.zeros((frames, frames))
    for offset in range(min(len(band), frames)):
        values = band[offset, : frames - offset]
        matrix[np.arange(offset, frames), np.arange(frames - offset)] = values
        matrix[np.arange(frames - offset), np.arange(offset, frames)] = values
    return matrix


@given(st.integers(1, 60), st.integers(1, 6))
@settings(max_examples=80, deadline=None)
def test_the_smoothness_band_is_the_power_of_w_w(frames: int, order: int) -> None:
    band = smoothness_band(frames, order)
    assert band.shape == (order + 1, frames)
    np.testing.assert_array_equal(unpacked(band), dense_smoothness(frames, order))


def test_the_shared_band_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        smoothness_band(10, 2)[0, 0] = 1


def system(frames: int, order: int, count: int, smoothness: float, seed: int) -> tuple[Array, Array, Array]:
    random = np.random.default_rng(seed)
    diagonal = np.exp(random.uniform(np.log(1e-2), np.log(1e2), (frames, count)))
    return diagonal, smoothness * smoothness_band(frames, order), random.standard_normal((frames, count)) * 10


@given(
    st.integers(1, 300),
    st.integers(1, 4),
    st.integers(1, 5),
    st.floats(1e-3, 1e3),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=40, deadline=None)
def test_the_solution_is_the_dense_one(frames: int, order: int, count: int, smoothness: float, seed: int) -> None:
    diagonal, band, right = system(frames, order, count, smoothness, seed)
    solution = np.empty_like(right)
    solve(diagonal, band, right, solution)
    matrix = smoothness * dense_smoothness(frames, order)
    for k in range(count):
        expected = np.linalg.solve(matrix + np.diag(diagonal[:, k]), right[:, k])
        np.testing.assert_allclose(solution[:, k], expected, rtol=0, atol=1e-6 * np.abs(expected).max())


class Counting(np.ndarray):
    """Counts how many of its elements are read."""

    reads = 0

    def __getitem__(self, key):  # type: ignore[no-untyped-def]
        Counting.reads += 1
        return super().__getitem__(key)


def test_the_work_grows_in_proportion_to_the_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    def zeros(shape: tuple[int, ...]) -> Counting:
        return np.zeros(shape).view(Counting)

    systems = [system(frames, 2, 1, 2.0, 0) for frames in (50, 100, 200)]
    monkeypatch.setattr(banded, "np", SimpleNamespace(zeros=zeros, sqrt=np.sqrt))
    reads = []
    for diagonal, band, right in systems:
        Counting.reads = 0
        solve.py_func(diagonal, band.view(Counting), right, np.empty_like(right).view(Counting))
        reads.append(Counting.reads)
    assert reads[1] - reads[0] > 0
    assert reads[2] - reads[1] == 2 * (reads[1] - reads[0])


def test_no_square_matrix_is_ever_held() -> None:
    diagonal, band, right = system(4000, 2, 1, 2.0, 0)
    solution = np.empty_like(right)
    tracemalloc.start()
    try:
        solve.py_func(diagonal, band, right, solution)  # the compiled one's memory cannot be traced
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1 * 2**20, "4000 x 4000 doubles would be 122 MB"
    compiled = np.empty_like(right)
    solve(diagonal, band, right, compiled)
    np.testing.assert_allclose(compiled, solution, atol=1e-10)
