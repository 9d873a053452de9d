# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""Keeps points where they are on a mesh that deforms: hairs on the skin."""

from __future__ import annotations

import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

Array = NDArray[np.float64]


def triangle_tree(vertices: Array, triangles: NDArray[np.intp]) -> BVHTree:
    """Answers which of the triangles (t, 3) of vertices (n, 3) is nearest to a point."""
    return BVHTree.FromPolygons([tuple(vertex) for vertex in vertices], [tuple(face) for face in triangles.tolist()])


class Glue:
    """Points kept in place relative to the nearest triangle of a deforming mesh."""

    def __init__(self, rest: Array, triangles: NDArray[np.intp], points: Array) -> None:
        """Args: rest (n, 3), triangles (t, 3), points (s, k, 3) whose first of k is the root."""
        tree = triangle_tree(rest, triangles)
        self._triangles = triangles[[tree.find_nearest(Vector(root))[2] for root in points[:, 0]]]
        first, second, third, axes = self._frames(rest)
        self._shares = _barycentric(first, second, third, points[:, 0])
        root = self._root(first, second, third)
        self._local = np.einsum("nij,nkj->nki", axes, points - root[:, None])

    def follow(self, vertices: Array) -> Array:
        """The points (s, k, 3) on the deformed mesh (n, 3)."""
        first, second, third, axes = self._frames(vertices)
        points: Array = self._root(first, second, third)[:, None] + np.einsum("nij,nki->nkj", axes, self._local)
        return points

    def _frames(self, vertices: Array) -> tuple[Array, Array, Array, Array]:
        first, second, third = (vertices[self._triangles[:, corner]] for corner in range(3))
        edge = second - first
        normal = np.cross(edge, third - first)
        edge = edge / np.linalg.norm(edge, axis=1)[:, None]
        normal = normal / (np.linalg.norm(normal, axis=1)[:, None] + 1e-12)
        return first, second, third, np.stack([edge, normal, np.cross(normal, edge)], 1)

    def _root(self, first: Array, second: Array, third: Array) -> Array:
        a, b, c = self._shares
        root: Array = a[:, None] * first + b[:, None] * second + c[:, None] * third
        return root


def _barycentric(first: Array, second: Array, third: Array, points: Array) -> tuple[Array, Array, Array]:
    """Shares (n,) of the three corners in each point (n, 3)."""
    side, other, way = second - first, third - first, points - first
    d00, d01, d11 = (side * side).sum(1), (side * other).sum(1), (other * other).sum(1)
    d20, d21 = (way * side).sum(1), (way * other).sum(1)
    area = d00 * d11 - d01**2
    b, c = (d11 * d20 - d01 * d21) / area, (d00 * d21 - d01 * d20) / area
    return 1 - b - c, b, c
