# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""Meshes and strands in Blender's scene, from and to MakeHuman's frame.

MakeHuman: x to her left, y up, z to the front, decimetres. Blender: x to her left, y to the back, z up, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
METRES = 0.1  # a decimetre


def to_blender(points: Any) -> Array:
    """Points (..., 3) of MakeHuman's frame in Blender's."""
    points = np.asarray(points)
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], -1) * METRES


def from_blender(points: Any) -> Array:
    """Points (..., 3) of Blender's frame in MakeHuman's."""
    points = np.asarray(points)
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], -1) / METRES


def link(name: str, data: Any) -> Any:
    """A new object in the scene."""
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_mesh(
    name: str, vertices: Array, faces: Sequence[Sequence[int]], *, texture: Any = None, subdivisions: int = 0
) -> Any:
    """A smooth mesh of vertices (n, 3), dm; `texture` holds u and v of every corner of every face."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(to_blender(vertices).tolist(), [], faces)
    mesh.update()
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    if texture is not None:
        mesh.uv_layers.new(name="uv").data.foreach_set("uv", np.asarray(texture, np.float32).ravel())
    thing = link(name, mesh)
    if subdivisions:
        modifier = thing.modifiers.new("subdivisions", "SUBSURF")
        modifier.levels = modifier.render_levels = subdivisions
    return thing


def move_mesh(thing: Any, vertices: Array) -> None:
    """Give a mesh new vertices (n, 3), dm."""
    thing.data.vertices.foreach_set("co", to_blender(vertices).astype(np.float32).ravel())
    thing.data.update()


def add_strands(name: str, points: Array, radii: Any, material: Any) -> Any:
    """Hair curves of points (n, k, 3), dm, with radii (k,) in metres."""
    count, length = points.shape[:2]
    curves = bpy.data.hair_curves.new(name)
    curves.add_curves([length] * count)
    curves.attributes["position"].data.foreach_set("vector", to_blender(points).astype(np.float32).ravel())
    radius = curves.attributes.get("radius") or curves.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.broadcast_to(np.asarray(radii), (count, length)).astype(np.float32).ravel())
    curves.materials.append(material)
    return link(name, curves)


def move_strands(thing: Any, points: Array) -> None:
    """Give hair curves new points (n, k, 3), dm."""
    thing.data.attributes["position"].data.foreach_set("vector", to_blender(points).astype(np.float32).ravel())
    thing.data.update_tag()
