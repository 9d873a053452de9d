"""Flow and texture modes of a recording: the principal components of its flows, and of its textures on one grid."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from app.engine.background import Planes
from app.engine.mmm import pull
from app.engine.modes import MESH_STEP, Modes, densify, split_texture
from app.engine.training.em_pca import em_pca

Float = NDArray[np.float32]

BLOCK = 64
"""Frames held at once."""

SQUASHED = 0.35
"""A texture point whose neighbourhood shrinks below this share of its area at rest is inside the mouth."""


def frame_planes(flat: NDArray[np.uint8], width: int, height: int) -> Planes:
    """Float planes of one flattened frame (P,)."""
    return split_texture(flat.astype(np.float32), width, height)


def fit_modes(
    frames: NDArray[np.uint8],
    flows: NDArray[np.float16],
    width: int,
    height: int,
    *,
    rest: NDArray[np.int64],
    flow_count: int = 12,
    texture_count: int = 34,
    seed: int = 0,
) -> tuple[Modes, Float]:
    """Modes, and the coefficients (T, K) of every frame.

    Args:
        frames: (T, P) uint8 planes.
        flows: (T, H, W, 2) from the texture grid to each frame.
        width, height: of the frames.
        rest: frames that show the mouth at rest.
        flow_count, texture_count: KF and KT.
        seed: of EM-PCA's start.
    """
    vertices = flows[:, ::MESH_STEP, ::MESH_STEP]
    mesh = vertices.shape[1:]

    def flow_blocks() -> Iterator[Float]:
        for start in range(0, len(vertices), BLOCK):
            yield vertices[start : start + BLOCK].reshape(-1, int(np.prod(mesh))).astype(np.float32)

    flow = em_pca(flow_blocks, flow_count, seed=seed)
    flow_coefficients = flow.project(flow_blocks)

    def dense(coefficients: Float) -> Float:
        return densify(flow.restore(coefficients).reshape(mesh), width, height)

    def texture_blocks() -> Iterator[Float]:
        for start in range(0, len(frames), BLOCK):
            yield np.stack(
                [
                    pull(frame_planes(frame, width, height), dense(coefficient))
                    for frame, coefficient in zip(
                        frames[start : start + BLOCK], flow_coefficients[start : start + BLOCK], strict=True
                    )
                ]
            )

    pulled = np.concatenate([block.astype(np.float16) for block in texture_blocks()])

    def stored_blocks() -> Iterator[Float]:
        for start in range(0, len(pulled), BLOCK):
            yield pulled[start : start + BLOCK].astype(np.float32)

    texture = em_pca(stored_blocks, texture_count, seed=seed)
    texture_coefficients = texture.project(stored_blocks)
    at_rest = flow_coefficients[rest].mean(0) @ flow.axes + flow.mean
    modes = Modes(
        width=width,
        height=height,
        flow_mean=flow.mean.reshape(mesh),
        flow_modes=flow.axes.reshape(-1, *mesh),
        texture_mean=texture.mean,
        texture_modes=texture.axes,
        layer=skin_layer(at_rest.reshape(mesh)),
        detail=np.zeros_like(texture.mean),
    )
    return modes, np.concatenate([flow_coefficients, texture_coefficients], 1)


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
