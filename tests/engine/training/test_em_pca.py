from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.training.corpus import Corpus
from app.engine.training.em_pca import Blocks, Components, em_pca

Float = NDArray[np.float32]


def in_blocks(data: Float, size: int) -> Blocks:
    def blocks() -> Iterator[Float]:
        for start in range(0, len(data), size):
            yield data[start : start + size]

    return blocks


def made(samples: int = 150, width: int = 90, decay: float = 0.7, seed: int = 0) -> Float:
    """Data whose variances fall by a steady factor."""
    random = np.random.default_rng(seed)
    axes = np.linalg.qr(random.standard_normal((width, 30)))[0].T
    hidden = random.standard_normal((samples, 30)) * 20 * decay ** np.arange(30)
    return (hidden @ axes + random.uniform(50, 200, width)).astype(np.float32)


def by_svd(data: Float, count: int) -> tuple[Float, Float, NDArray[np.float64]]:
    mean = data.mean(0, dtype=np.float64)
    _, values, axes = np.linalg.svd(data - mean, full_matrices=False)
    return mean.astype(np.float32), axes[:count].astype(np.float32), values[:count] ** 2 / len(data)


def assert_same(found: Components, data: Float, count: int, tolerance: float) -> None:
    mean, axes, variance = by_svd(data, count)
    np.testing.assert_allclose(found.mean, mean, atol=1e-3)
    np.testing.assert_allclose(found.variance, variance, rtol=tolerance)
    np.testing.assert_allclose(np.abs((found.axes * axes).sum(1)), 1, atol=tolerance)


@pytest.mark.parametrize("size", [7, 64, 1000])
def test_components_are_those_of_the_singular_value_decomposition(size: int) -> None:
    data = made()
    assert_same(em_pca(in_blocks(data, size), 6, passes=40), data, 6, 1e-4)


def test_twelve_passes_are_enough_for_mouths(corpus: Corpus) -> None:
    data = corpus.frames.take(np.flatnonzero(corpus.good)[:300]).astype(np.float32)
    found = em_pca(in_blocks(data, 16), 8)
    _, _, variance = by_svd(data, 8)
    assert found.variance.sum() > 0.999 * variance.sum()
    np.testing.assert_allclose(found.variance[:5], variance[:5], rtol=1e-3)


def test_axes_are_orthonormal_by_falling_variance_with_a_settled_sign() -> None:
    found = em_pca(in_blocks(made(), 32), 8)
    np.testing.assert_allclose(found.axes @ found.axes.T, np.eye(8), atol=1e-4)
    assert (np.diff(found.variance) <= 0).all()
    assert (found.axes[np.arange(8), np.abs(found.axes).argmax(1)] > 0).all()


def test_projecting_and_restoring_keeps_what_the_components_span() -> None:
    data = made()
    blocks = in_blocks(data, 32)
    found = em_pca(blocks, 30, passes=20)
    coefficients = found.project(blocks)
    assert coefficients.shape == (150, 30)
    np.testing.assert_allclose(coefficients.mean(0), 0, atol=1e-2)
    np.testing.assert_allclose(coefficients.var(0), found.variance, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(found.restore(coefficients), data, atol=0.05)
    np.testing.assert_allclose(found.restore(coefficients[3]), data[3], atol=0.05)


def test_the_same_seed_gives_the_same_bits_and_another_the_same_space() -> None:
    blocks = in_blocks(made(), 32)
    first, again, other = (em_pca(blocks, 4, passes=30, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.axes, again.axes)
    np.testing.assert_allclose(first.axes, other.axes, atol=1e-3)


@pytest.mark.parametrize(("samples", "width", "expected"), [(5, 90, 4), (150, 3, 3)])
def test_there_are_no_more_components_than_the_data_has(samples: int, width: int, expected: int) -> None:
    data = np.random.default_rng(0).standard_normal((samples, width)).astype(np.float32)
    found = em_pca(in_blocks(data, 32), 10, passes=30)
    assert found.axes.shape == (expected, width)
    np.testing.assert_allclose(found.restore(found.project(in_blocks(data, 32))), data, atol=1e-2)


def test_the_data_are_read_once_a_pass_and_a_block_at_a_time() -> None:
    data, passes, alive = made(), [0], [0]

    def blocks() -> Iterator[Float]:
        passes[0] += 1
        for start in range(0, len(data), 10):
            alive[0] += 1
            yield data[start : start + 10].copy()

    em_pca(blocks, 3, passes=5)
    assert passes[0] == 1 + 5 + 1  # mean, iterations, variances
    assert alive[0] == passes[0] * 15
