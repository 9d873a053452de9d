# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""The upper eyelashes. The lower ones would be dots in 512 pixels, and are left out."""

from __future__ import annotations

import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from avatars.mary.studio.blender.glue import triangle_tree
from avatars.mary.studio.blender.hair_material import hair_material
from avatars.mary.studio.blender.objects import add_strands, move_strands
from avatars.mary.studio.face import Face
from avatars.mary.studio.head import HeadPose, turned

Array = NDArray[np.float64]
Pairs = NDArray[np.intp]
ALONG = np.linspace(0, 1, 6)  # from a lash's root to its tip
UPPER = 2  # MakeHuman's number of the upper strip


class Lashes:
    """The lashes of one eye; they grow from the root edge of MakeHuman's strip, and lift as it does in a blink."""

    def __init__(self, face: Face, side: str, triangles: Pairs, noise: np.random.Generator) -> None:
        """Args: side: `l` or `r`; triangles (t, 3) of the body."""
        self._neck = face.neck
        roots, tips = _strip(face, side, triangles)
        middles = face.rest[roots].mean(1)[:, 0]
        across = (middles - (middles.max() + middles.min()) / 2) / ((middles.max() - middles.min()) / 2)
        kept = np.abs(across) < 0.74  # the strip's ends reach around the corners of the eye
        self._roots, self._tips, across = roots[kept], tips[kept], across[kept]
        self._rest_lift = self._lift(face.rest)
        count = face.look.lash_strands
        self._segment = noise.integers(0, len(self._roots), count)
        self._place = noise.random(count)[:, None]
        self._length = noise.uniform(0.75, 1.1, count)[:, None]
        scatter = noise.normal(0, 0.015, (count, 3)) * 0.12
        if side == "l":  # hers lean to the nose: by mistake, but the recording has them so, and new frames must match
            across = -across
        outwards = np.stack([across[self._segment] * 0.045, np.full(count, 0.020), np.full(count, 0.062)], 1)
        self._way = outwards + scatter
        material = hair_material(f"{side} lashes", face.look.lash_melanin)
        radii = np.linspace(0.00007, 0.00002, len(ALONG))
        self.object = add_strands(f"{side} lashes", self._hairs(face.rest), radii, material)

    def follow(self, vertices: Array, pose: HeadPose) -> None:
        """Go along with the deformed face (n, 3), then with the head."""
        move_strands(self.object, turned(self._hairs(vertices), pose, self._neck))

    def _lift(self, vertices: Array) -> Array:
        """(3,) mean way from the strip's roots to its tips."""
        lift: Array = (vertices[self._tips] - vertices[self._roots]).mean((0, 1))
        return lift

    def _hairs(self, vertices: Array) -> Array:
        """(count, 6, 3) points, dm."""
        ends = vertices[self._roots[self._segment]]
        root = ends[:, 0] * (1 - self._place) + ends[:, 1] * self._place - np.array([0, 0.004, 0.006])
        lift = (self._lift(vertices) - self._rest_lift) * np.array([0, 0.8, 0.2])
        way = (self._way + lift) * self._length
        curl = np.array([0, 0.026, 0]) * ((ALONG**2 - ALONG)[None, :, None]) * 1.6
        hairs: Array = root[:, None] + way[:, None] * ALONG[None, :, None] + curl
        return hairs


def _strip(face: Face, side: str, triangles: Pairs) -> tuple[Pairs, Pairs]:
    """(m, 2) vertices at the root and at the tip of each quad of the strip, opposite ones at the same place.

    The root is the side that is nearer to the skin.
    """
    quads = face.mesh.faces_of(f"helper-{side}-eyelashes-{UPPER}")
    skin = triangle_tree(face.rest, triangles)
    members = np.unique(quads)
    distance = {int(vertex): skin.find_nearest(Vector(face.rest[vertex]))[3] for vertex in members}
    roots, tips = [], []
    for quad in quads:
        root = sorted(quad, key=lambda vertex: distance[vertex])[:2]
        far = [vertex for vertex in quad if vertex not in root]
        at = quad.index(root[0])
        beside = [vertex for vertex in (quad[(at + 1) % 4], quad[at - 1]) if vertex in far]
        if beside:
            roots.append(root)
            tips.append([beside[0], next(vertex for vertex in far if vertex != beside[0])])
    return np.array(roots), np.array(tips)
