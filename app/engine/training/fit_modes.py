"""Flow and texture modes of a recording: the principal components of its flows, and of its textures on one grid.

Errors count by the importance of their pixel: components are those of weighted data, so that they spend themselves on
lips and teeth and not on the collar.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.background import Planes
from app.engine.mmm import pull
from app.engine.modes import MESH_STEP, Modes, densify, split_texture
from app.engine.training.em_pca import Blocks, em_pca

Float = NDArray[np.float32]

FLOW_MODES, TEXTURE_MODES = 12, 34
NOTHING = 0.02
"""Importance below this is none: modes are zero there."""

SQUASHED = 0.35
"""A texture point whose neighbourhood shrinks below this share of its area at rest is inside the mouth."""


@dataclass(frozen=True)
class Weights:
    """Importance of every number of a mouth, in 0..1.

    Attributes:
        flow: (h, w, 1) of the mesh vertices.
        texture: (P,) of the planes, flattened.
    """

    flow: Float
    texture: Float

    @classmethod
    def of(cls, importance: Float) -> Weights:
        """From the importance (H, W) of the crop's pixels."""
        height, width = importance.shape
        half = cv2.resize(importance, (width // 2, height // 2), interpolation=cv2.INTER_AREA).ravel()
        kept = np.concatenate([importance.ravel(), half, half]).astype(np.float32)
        mesh = importance[::MESH_STEP, ::MESH_STEP, None]
        return cls(np.where(mesh < NOTHING, 0, mesh).astype(np.float32), np.where(kept < NOTHING, 0, kept))


def frame_planes(flat: NDArray[np.uint8], width: int, height: int) -> Planes:
    """Float planes of one flattened frame (P,)."""
    return split_texture(flat.astype(np.float32), width, height)


def fit_flow(blocks: Blocks, weights: Weights, *, count: int = FLOW_MODES, seed: int = 0) -> tuple[Float, Float]:
    """Mean (h, w, 2) and modes (K, h, w, 2) of the flows that `blocks` yields, (n, h, w, 2) of mesh vertices."""
    mesh = (*weights.flow.shape[:2], 2)
    root = np.broadcast_to(np.sqrt(weights.flow), mesh).reshape(-1)
    mean, modes = _weighted(_flat(blocks), root, count, seed)
    return mean.reshape(mesh), modes.reshape(-1, *mesh)


def fit_texture(blocks: Blocks, weights: Weights, *, count: int = TEXTURE_MODES, seed: int = 0) -> tuple[Float, Float]:
    """Mean (P,) and modes (K, P) of the textures that `blocks` yields, (n, P)."""
    return _weighted(_flat(blocks), np.sqrt(weights.texture), count, seed)


def _flat(blocks: Blocks) -> Blocks:
    def each() -> Iterator[Float]:
        for block in blocks():
            yield block.reshape(len(block), -1).astype(np.float32)

    return each


def _weighted(blocks: Blocks, root: Float, count: int, seed: int) -> tuple[Float, Float]:
    """Mean and components of data whose numbers count by `root` squared, as modes of the data itself."""
    total, samples = np.zeros(len(root)), 0
    for block in blocks():
        total += block.sum(0, dtype=np.float64)
        samples += len(block)
    mean = (total / samples).astype(np.float32)
    used = np.flatnonzero(root > 0)
    scale = root[used].astype(np.float32)

    def each() -> Iterator[Float]:
        for block in blocks():
            yield (block[:, used] - mean[used]) * scale

    components = em_pca(each, count, seed=seed)
    modes = np.zeros((len(components.axes), len(root)), np.float32)
    modes[:, used] = components.axes / scale
    return mean, modes


class Analysis:
    """From frames and their flows to mode coefficients, by weighted least squares.

    The modes are orthonormal in the weighted sense, so a projection is the solution.
    """

    def __init__(self, modes: Modes, weights: Weights) -> None:
        self._modes = modes
        flow = modes.flow_modes * weights.flow
        self._of_flow = np.ascontiguousarray(flow.reshape(modes.flow_count, -1).T)
        self._of_texture = np.ascontiguousarray((modes.texture_modes * weights.texture).T)

    def flow(self, vertices: Float) -> Float:
        """(KF,) flow coefficients of a flow (h, w, 2)."""
        coefficients: Float = (vertices - self._modes.flow_mean).reshape(-1) @ self._of_flow
        return coefficients

    def texture(self, pulled: Float) -> Float:
        """(KT,) texture coefficients of a texture (P,)."""
        coefficients: Float = (pulled - self._modes.texture_mean) @ self._of_texture
        return coefficients

    def __call__(self, flat: NDArray[np.uint8], vertices: Float) -> Float:
        """(K,) coefficients of one frame.

        Args:
            flat: (P,) planes.
            vertices: (h, w, 2) flow to it.
        """
        flow = self.flow(vertices)
        texture = self.texture(pulled_texture(self._modes, flat, flow))
        return np.concatenate([flow, texture]).astype(np.float32)


def pulled_texture(modes: Modes, flat: NDArray[np.uint8], flow: Float) -> Float:
    """(P,) what a frame looks like on the texture grid, seen through the flow of these coefficients (KF,)."""
    shown = np.tensordot(flow, modes.flow_modes, 1).astype(np.float32) + modes.flow_mean
    return pull(frame_planes(flat, modes.width, modes.height), densify(shown, modes.width, modes.height))


def skin_layer(flow: Float) -> Float:
    """(h, w) 1 on skin and lips, 0 where the mesh is squashed at rest: the inside of the mouth."""
    area = area_ratio(flow)
    return np.where(area < SQUASHED, 0, 1).astype(np.float32)


def area_ratio(flow: Float) -> Float:
    """(h, w) area of a mesh cell after a flow (h, w, 2), relative to before; negative where it turned over."""
    dx_x, dx_y = np.gradient(flow[..., 0], axis=1) / MESH_STEP, np.gradient(flow[..., 0], axis=0) / MESH_STEP
    dy_x, dy_y = np.gradient(flow[..., 1], axis=1) / MESH_STEP, np.gradient(flow[..., 1], axis=0) / MESH_STEP
    ratio: Float = ((1 + dx_x) * (1 + dy_y) - dx_y * dy_x).astype(np.float32)
    return ratio
