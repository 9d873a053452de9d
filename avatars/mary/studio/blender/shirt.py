# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""The shirt: the body's own surface, a little larger and smoother, cut off at the neck, with a rolled collar."""

from __future__ import annotations

from typing import Any

import bmesh
import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from avatars.mary.studio.blender.nodes import Graph
from avatars.mary.studio.blender.objects import link, to_blender
from avatars.mary.studio.face import Face
from avatars.mary.studio.look import Colour

Array = NDArray[np.float64]
OFFSET = 0.006  # m over the skin
ON_PLANE = 2e-3  # m: an edge so near to the cut is its border
LONGEST_RING = 2000  # vertices


def add_shirt(face: Face, body: Any) -> list[Any]:
    """Shirt and collar, made from the body's mesh at rest."""
    look = face.look
    cloth = _cloth(look.shirt)
    shape = bmesh.new()
    shape.from_mesh(body.data)
    normal = Vector((0, look.collar_tilt, 1)).normalized()
    point = Vector(to_blender(face.neck + np.array([0, look.collar_height, 0])))
    shape.normal_update()
    everything = shape.verts[:] + shape.edges[:] + shape.faces[:]
    normals = {vertex: vertex.normal.copy() for vertex in shape.verts}
    for vertex in shape.verts:
        vertex.co += normals[vertex] * OFFSET
    bmesh.ops.bisect_plane(shape, geom=everything, plane_co=point, plane_no=normal, clear_outer=True)
    for _ in range(6):
        inner = [vertex for vertex in shape.verts if not vertex.is_boundary]
        bmesh.ops.smooth_vert(shape, verts=inner, factor=0.5, use_axis_x=True, use_axis_y=True, use_axis_z=True)
    ring = _ring(shape, point, normal)
    mesh = bpy.data.meshes.new("shirt")
    shape.to_mesh(mesh)
    shape.free()
    mesh.materials.clear()
    shirt = link("shirt", mesh)
    thickness = shirt.modifiers.new("thickness", "SOLIDIFY")
    thickness.thickness, thickness.offset = 0.003, 1
    smooth = shirt.modifiers.new("subdivisions", "SUBSURF")
    smooth.levels = smooth.render_levels = 2
    mesh.materials.append(cloth)
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    return [shirt, _collar(ring, cloth)]


def _ring(shape: Any, point: Vector, normal: Vector) -> Array:
    """(n, 3) the border around the neck, in order, metres in Blender's frame."""
    beside: dict[Any, list[Any]] = {}
    for edge in shape.edges:
        if edge.is_boundary and all(abs((vertex.co - point).dot(normal)) < ON_PLANE for vertex in edge.verts):
            first, second = edge.verts
            beside.setdefault(first, []).append(second)
            beside.setdefault(second, []).append(first)
    start = next(iter(beside))
    ring, before, here = [start], None, start
    while len(ring) <= LONGEST_RING:
        onwards = [vertex for vertex in beside[here] if vertex is not before]
        if not onwards or onwards[0] is start:
            break
        before, here = here, onwards[0]
        ring.append(here)
    return np.array([list(vertex.co) for vertex in ring])


def _collar(ring: Array, cloth: Any) -> Any:
    curve = bpy.data.curves.new("collar", "CURVE")
    curve.dimensions = "3D"
    curve.bevel_depth, curve.bevel_resolution = 0.0045, 4
    for _ in range(4):
        ring = (np.roll(ring, 1, 0) + 2 * ring + np.roll(ring, -1, 0)) / 4
    spline = curve.splines.new("NURBS")
    spline.points.add(len(ring) - 1)
    spline.points.foreach_set("co", np.c_[ring, np.ones(len(ring))].astype(np.float32).ravel())
    spline.use_cyclic_u = True
    collar = link("collar", curve)
    curve.materials.append(cloth)
    return collar


def _cloth(colour: Colour) -> Any:
    """Dark and dull, woven, with soft folds."""
    graph = Graph("cloth")
    place = graph.add("TexCoord").outputs["Object"]
    weave = graph.add("TexWave")
    weave.inputs["Scale"].default_value, weave.inputs["Distortion"].default_value = 230, 2
    graph.set(weave.inputs["Vector"], place)
    normal = graph.bump(weave.outputs["Fac"], 0.35, 0.0008)
    normal = graph.bump(graph.noise(14, 3, at=place), 0.5, 0.012, normal)
    shader = graph.principled(
        base_color=colour, roughness=0.9, sheen_weight=0.06, specular_ior_level=0.2, normal=normal
    )
    return graph.surface(shader.outputs[0])
