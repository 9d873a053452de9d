"""The tongue's own movements; the face units only carry it a part of the way with the jaw."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.face import Controls
from avatars.mary.studio.smoothstep import smoothstep

Array = NDArray[np.float64]
BEHIND_TEETH = np.array([np.nan, 6.118, 1.255])  # dm: where the tip touches for L, T, D and N; x stays
BETWEEN_TEETH = np.array([np.nan, 6.088, 1.365])  # dm: where it shows for TH and DH


def tongue(carried: Array, rest: Array, controls: Controls) -> Array:
    """The tongue's vertices (t, 3), dm, head not turned.

    Args:
        carried: (t, 3) as the face units leave it.
        rest: (t, 3) at rest.
        controls: `tTip` and `tBody` raise tip and body, `tThin` flattens the tip, `tL` and `tOut` bring it behind or
            between the teeth; `jawOpen` lowers it.
    """
    vertices = carried.copy()
    depth = rest[:, 2]
    forward = smoothstep(depth.min() + 0.12, depth.max(), depth)  # 0 at the root, 1 at the tip
    body = np.exp(-(((depth - (depth.min() + 0.32)) / 0.22) ** 2))
    vertices[:, 1] += controls.get("jawOpen", 0) * -0.05 * forward
    vertices[:, 1] += controls.get("tTip", 0) * 0.16 * forward**2 + controls.get("tBody", 0) * 0.16 * body
    vertices[:, 2] += controls.get("tTip", 0) * 0.01 * forward
    thin = 0.55 * forward**3 * controls.get("tThin", 0)
    vertices[:, 1] = vertices[:, 1] * (1 - thin) + vertices[forward > 0.85, 1].mean() * thin
    behind = min(1, controls.get("tL", 0))
    if behind:
        weight = (forward**1.3 * behind)[:, None]
        vertices += weight * _way(vertices, forward, BEHIND_TEETH)
    between = min(1, controls.get("tOut", 0))
    if between:
        weight = (forward**1.6 * between)[:, None]
        middle = vertices[forward > 0.9, 0].mean()
        vertices += weight * _way(vertices, forward, BETWEEN_TEETH)
        vertices[:, 0] = middle + (vertices[:, 0] - middle) * (1 - 0.38 * weight[:, 0])
    return vertices


def _way(vertices: Array, forward: Array, goal: Array) -> Array:
    """(3,) from the middle of the tip to the goal."""
    tip = vertices[forward > 0.9].mean(0)
    way: Array = np.where(np.isnan(goal), 0.0, goal - tip)
    return way
