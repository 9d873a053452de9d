# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""Points on the skin as it is rendered: found once, followed through every deformation."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from avatars.mary.studio.blender.objects import METRES, from_blender
from avatars.mary.studio.camera import Camera

Array = NDArray[np.float64]


class SurfacePoints:
    """Points glued to the smooth (subdivided) surface of a mesh."""

    def __init__(self, thing: Any, camera: Camera, pixels: dict[str, tuple[int, int]], size: int) -> None:
        """The points that the middles of these pixels show, as the mesh is now.

        Args:
            thing: Blender's mesh object, at rest; it must not be moved or scaled itself.
            camera: that takes the picture.
            pixels: column and row by name.
            size: the picture's, pixels.
        """
        self._thing = thing
        vertices, triangles = self._evaluated()
        tree = BVHTree.FromPolygons([tuple(vertex) for vertex in vertices], [tuple(face) for face in triangles])
        eye = -camera.view[:3, :3].T @ camera.view[:3, 3]
        self.names = list(pixels)
        corners, shares = [], []
        for column, row in pixels.values():
            across, up = (column + 0.5) / size - 0.5, 0.5 - (row + 0.5) / size
            way = camera.view[:3, :3].T @ np.array([across / camera.focal, up / camera.focal, -1])
            hit, _, number, _ = tree.ray_cast(Vector(eye), Vector(way))
            if hit is None:
                raise ValueError(f"pixel {column}, {row} does not show the surface")
            corners.append(triangles[number])
            shares.append(_shares(np.array(hit), vertices[list(triangles[number])]))
        self._corners, self._shares = np.array(corners), np.array(shares)

    def where(self) -> Array:
        """(n, 3) the points on the mesh as it is now, dm in MakeHuman's frame."""
        vertices, _ = self._evaluated(faces=False)
        return from_blender((vertices[self._corners] * self._shares[..., None]).sum(1))

    def _evaluated(self, *, faces: bool = True) -> tuple[Array, list[tuple[int, int, int]]]:
        """Vertices (n, 3) in metres, Blender's frame, and triangles of the surface."""
        evaluated = self._thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh = evaluated.to_mesh()
        points = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", points)
        triangles: list[tuple[int, int, int]] = []
        if faces:
            for polygon in mesh.polygons:
                first, *others = polygon.vertices
                triangles += [(first, others[at], others[at + 1]) for at in range(len(others) - 1)]
        evaluated.to_mesh_clear()
        return points.reshape(-1, 3).astype(np.float64), triangles


def _shares(point: Array, corners: Array) -> Array:
    """(3,) barycentric coordinates of a point in the plane of a triangle (3, 3)."""
    a, b, c = corners / METRES
    system = np.stack([b - a, c - a], 1)
    second, third = np.linalg.lstsq(system, point / METRES - a, rcond=None)[0]
    return np.array([1 - second - third, second, third])
