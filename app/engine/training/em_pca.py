"""EM for principal components, streaming over blocks of frames (Roweis 1998; Fu 2011, 3.1).

Each pass reads the data once and holds one block, so a recording of any length needs the memory of its components.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float32]
Blocks = Callable[[], Iterator[Float]]
"""Starts a pass over the data: yields blocks (n, P) in order."""


@dataclass(frozen=True)
class Components:
    """Mean (P,), orthonormal components (K, P) by falling variance, and the variance (K,) of each."""

    mean: Float
    axes: Float
    variance: NDArray[np.float64]

    def project(self, blocks: Blocks) -> Float:
        """(T, K) coefficients of all data."""
        return np.concatenate([(block - self.mean) @ self.axes.T for block in blocks()]).astype(np.float32)

    def restore(self, coefficients: Float) -> Float:
        """(..., P) data of coefficients (..., K)."""
        return coefficients @ self.axes + self.mean


def em_pca(blocks: Blocks, count: int, *, passes: int = 12, seed: int = 0) -> Components:
    """The leading principal components of data that is only ever seen in blocks.

    Args:
        blocks: starts a pass over the data (n, P) float32.
        count: K; fewer are returned if the data has fewer samples than that.
        passes: EM iterations; twelve equal an exact decomposition on mouth pictures.
        seed: of the random start.
    """
    samples, mean = 0, np.zeros(0)
    for block in blocks():
        total = block.sum(0, dtype=np.float64)
        mean = total if samples == 0 else mean + total
        samples += len(block)
    mean /= samples
    count = min(count, samples - 1, len(mean))
    centre = mean.astype(np.float32)
    axes = np.random.default_rng(seed).standard_normal((count, len(mean))).astype(np.float32)
    for _ in range(passes):
        axes = _orthonormal(axes)
        moment = np.zeros((count, count))
        cross = np.zeros((count, len(mean)), np.float32)
        for block in blocks():
            centred = block - centre
            hidden = centred @ axes.T  # E step: with orthonormal axes the pseudo-inverse is the transpose
            moment += hidden.T.astype(np.float64) @ hidden
            cross += hidden.T @ centred
        ridge = 1e-9 * np.trace(moment) / count * np.eye(count)
        axes = np.linalg.solve(moment + ridge, cross.astype(np.float64)).astype(np.float32)  # M step
    axes = _orthonormal(axes)
    spread = np.zeros((count, count))
    for block in blocks():
        hidden = (block - centre) @ axes.T
        spread += hidden.T.astype(np.float64) @ hidden
    variance, turn = np.linalg.eigh(spread / samples)
    order = np.argsort(variance)[::-1]
    axes = (turn[:, order].T @ axes).astype(np.float32)
    signs = np.sign(axes[np.arange(count), np.abs(axes).argmax(1)]).astype(np.float32)
    return Components(centre, axes * signs[:, None], variance[order])


def _orthonormal(axes: Float) -> Float:
    basis, _ = np.linalg.qr(axes.T.astype(np.float64))
    return basis.T.astype(np.float32)
