"""Flow from the reference to every frame, chained through frames that look alike (Ezzat 2002 concatenates flow).

One-shot flow from a wide-open mouth to a closed one is wrong by pixels. Frames are joined to their nearest neighbours
in PCA space; the shortest path from the reference, with squared distances so that many small steps win over one large
one, is a chain of easy flows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import shortest_path
from sklearn.neighbors import NearestNeighbors

from app.engine.warp import pixel_grid, sample

Float = NDArray[np.float32]


def dense_flow(source: Float, target: Float) -> Float:
    """(H, W, 2) flow with target(p + flow(p)) = source(p), by DIS at twice the resolution.

    Args:
        source, target: (H, W) luma.
    """
    size = (source.shape[1], source.shape[0])
    twice = [_twice(image) for image in (source, target)]
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(*twice, None)  # type: ignore[call-overload]
    return cast(Float, (cv2.resize(flow, size, interpolation=cv2.INTER_AREA) / 2).astype(np.float32))


def _twice(image: Float) -> NDArray[np.uint8]:
    large = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    return np.clip(large, 0, 255).astype(np.uint8)


def compose(first: Float, second: Float) -> Float:
    """The flow of `first`, then `second`: p -> p + first(p) -> ... + second there."""
    height, width = first.shape[:2]
    return first + sample(second, first + pixel_grid(width, height), smooth=False)


def chained_flows(
    luma: Callable[[int], Float],
    coefficients: Float,
    reference: int,
    *,
    neighbours: int = 8,
    progress: Callable[[float], None] = lambda _: None,
) -> NDArray[np.float16]:
    """Flows from the reference to all frames, (T, H, W, 2), half precision (a hundredth of a pixel).

    Args:
        luma: gives the (H, W) luma of a frame.
        coefficients: (T, K), PCA coefficients that say which frames look alike.
        reference: frame number.
        neighbours: edges of the graph from each frame.
        progress: told the share done.
    """
    count = len(coefficients)
    distance, near = NearestNeighbors(n_neighbors=min(neighbours + 1, count)).fit(coefficients).kneighbors(coefficients)
    rows = np.repeat(np.arange(count), near.shape[1])
    graph = csr_matrix((distance.ravel() ** 2 + 1e-6, (rows, near.ravel())), (count, count))
    graph = graph.maximum(graph.T)
    length, previous = shortest_path(graph, directed=False, indices=reference, return_predecessors=True)
    first = luma(reference)
    flows = np.zeros((count, *first.shape, 2), np.float16)
    for done, frame in enumerate(np.argsort(length)):
        progress(done / count)
        if frame == reference:
            continue
        parent = int(previous[frame])
        if parent < 0:  # an island of the graph: one step must do
            flows[frame] = dense_flow(first, luma(int(frame)))
            continue
        step = dense_flow(luma(parent), luma(int(frame)))
        flows[frame] = compose(flows[parent].astype(np.float32), step)
    flows *= edge_taper(first.shape[1], first.shape[0])[..., None].astype(np.float16)
    return flows


EDGE = 10
"""Pixels over which flow falls to zero at the edge of the crop."""


def edge_taper(width: int, height: int) -> Float:
    """(height, width) 0 on the edge of the crop, 1 from `EDGE` pixels inwards.

    A flow that moved the edge itself would pull the mesh off the picture, and leave a line where it ends.
    """
    across = np.minimum(np.arange(width), np.arange(width)[::-1])
    down = np.minimum(np.arange(height), np.arange(height)[::-1])
    share = np.clip(np.minimum(across[None], down[:, None]) / EDGE, 0, 1)
    taper: Float = (share * share * (3 - 2 * share)).astype(np.float32)
    return taper
