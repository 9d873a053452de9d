# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""The eyebrows."""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from avatars.mary.studio.blender.glue import Glue
from avatars.mary.studio.blender.hair_material import hair_material
from avatars.mary.studio.blender.objects import add_strands, from_blender, move_strands, to_blender
from avatars.mary.studio.face import Face
from avatars.mary.studio.head import HeadPose, turned

Array = NDArray[np.float64]


class Brows:
    """Both brows; each hair is glued to the triangle that it grows from."""

    def __init__(self, face: Face, body: Any, triangles: NDArray[np.intp], noise: np.random.Generator) -> None:
        """Args: body: Blender's; triangles (t, 3): its vertices' numbers in the base mesh."""
        self._face = face
        points = np.array(_brow_hairs(face, _surface(body), noise))
        radii = np.array([0.00006, 0.00006, 0.00005, 0.00004, 0.00001])
        self.object = add_strands("brows", points, radii, hair_material("brows", face.look.brow_melanin))
        self._glue = Glue(face.rest, triangles, points)

    def follow(self, vertices: Array, pose: HeadPose) -> None:
        """Go along with the deformed face (n, 3), then with the head."""
        move_strands(self.object, turned(self._glue.follow(vertices), pose, self._face.neck))


def _surface(body: Any) -> BVHTree:
    """The body's smooth surface, in Blender's frame."""
    mesh = body.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    points = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", points)
    faces = [tuple(polygon.vertices) for polygon in mesh.polygons]
    return BVHTree.FromPolygons([tuple(point) for point in points.reshape(-1, 3)], faces)


def _brow_hairs(face: Face, surface: BVHTree, noise: np.random.Generator) -> list[list[Array]]:
    """Five points, dm, of each hair: up at the inner end of the brow, outwards along the rest."""
    brow = np.array(face.look.brow)
    along = np.linspace(0, 1, len(brow))
    hairs = []
    for side in (1, -1):
        for _ in range(face.look.brow_strands):
            place = noise.random() ** 0.9
            x, height, thickness = (float(np.interp(place, along, column)) for column in brow.T)
            above = float(np.clip(noise.normal(0, 0.5), -1.1, 1.1))
            start = np.array([side * x, face.eyes + height + above * thickness * 0.8, face.left_eye[2] + 2])
            hit, normal, *_ = surface.ray_cast(Vector(to_blender(start)), Vector((0, 1, 0)))
            if hit is None:
                continue
            root = from_blender(hit)
            outward = np.array([normal[0], normal[2], -normal[1]])
            slope = float(np.interp(place, [0, 0.25, 0.6, 1], [1.2, 0.6, 0.15, -0.45]))
            slope += -0.45 * above if place > 0.2 else -0.1 * above
            way = np.array([side * 1.0, slope + noise.normal(0, 0.15), 0])
            way /= np.linalg.norm(way)
            way -= outward * (way @ outward)
            way /= np.linalg.norm(way)
            length = float(np.interp(place, [0, 0.3, 0.8, 1], [0.065, 0.085, 0.075, 0.05])) * noise.uniform(0.6, 1.1)
            hairs.append(
                [
                    root
                    - outward * 0.006
                    + way * length * share
                    + outward * (0.012 * math.sin(share * 2.6) + 0.004)
                    - np.array([0, 0.010, 0]) * share * share
                    for share in np.linspace(0, 1, 5)
                ]
            )
    return hairs
