# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""Eyeballs with a flat iris behind a bulging cornea, fitted to MakeHuman's helpers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from avatars.mary.studio.blender.nodes import Graph
from avatars.mary.studio.blender.objects import METRES, link, to_blender
from avatars.mary.studio.face import Face
from avatars.mary.studio.head import HeadPose, turned
from avatars.mary.studio.look import Look
from avatars.mary.studio.smoothstep import smoothstep

Array = NDArray[np.float64]

IRIS = 0.46  # radians between the eye's axis and the edge of the iris
SEGMENTS = RINGS = 64
TO_BLENDER = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])


class Eyes:
    """Both eyes in Blender's scene."""

    def __init__(self, face: Face) -> None:
        centres = [_sphere(face.rest[face.mesh.members(f"helper-{side}-eye")]) for side in "lr"]
        self._centres = [centre for centre, _ in centres]
        self._neck = face.neck
        radius = centres[0][1] * METRES
        eyeball, cornea = _ball("eyeball", _eyeball(radius)), _ball("cornea", _cornea(radius))
        eyeball.materials.append(_iris_material(face.look, radius))
        cornea.materials.append(_cornea_material())
        self._eyeballs = []
        self.objects: list[Any] = []
        for side in ("left", "right"):
            inner, outer = link(f"{side} eye", eyeball), link(f"{side} cornea", cornea)
            outer.parent = inner
            outer.visible_shadow = False
            self._eyeballs.append(inner)
            self.objects += [inner, outer]

    def turn(self, pose: HeadPose) -> None:
        """Turn with the head, and in it."""
        rotation = TO_BLENDER @ pose.gaze @ TO_BLENDER.T
        for eyeball, centre in zip(self._eyeballs, self._centres, strict=True):
            matrix = Matrix(rotation.tolist()).to_4x4()
            matrix.translation = Vector(to_blender(turned(centre, pose, self._neck)))
            eyeball.matrix_world = matrix


def _sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) and radius of the sphere through points (n, 3), the foremost quarter (the cornea) left out."""
    points = points[points[:, 2] < np.percentile(points[:, 2], 75)]
    system = np.c_[2 * points, np.ones(len(points))]
    solution = np.linalg.lstsq(system, (points**2).sum(1), rcond=None)[0]
    return solution[:3], math.sqrt(solution[3] + (solution[:3] ** 2).sum())


def _eyeball(radius: float) -> Callable[[float], float]:
    flat = radius * math.cos(IRIS) * 0.985
    return lambda angle: min(flat / math.cos(angle), radius) if angle < IRIS else radius * 0.995


def _cornea(radius: float) -> Callable[[float], float]:
    return lambda angle: radius * (1 + 0.075 * float(smoothstep(0, 1, max(0, 1 - angle / (IRIS * 1.18)))))


def _ball(name: str, radius: Callable[[float], float]) -> Any:
    """A mesh whose distance from the centre, metres, depends on the angle from its axis, which points at the camera."""
    vertices, faces = [], []
    for ring in range(RINGS + 1):
        angle = math.pi * ring / RINGS
        distance = radius(angle)
        for segment in range(SEGMENTS):
            turn = 2 * math.pi * segment / SEGMENTS
            ring_radius = distance * math.sin(angle)
            vertices.append((ring_radius * math.cos(turn), -distance * math.cos(angle), ring_radius * math.sin(turn)))
    for ring in range(RINGS):
        for segment in range(SEGMENTS):
            beside = (segment + 1) % SEGMENTS
            here, behind = ring * SEGMENTS, (ring + 1) * SEGMENTS
            faces.append((here + segment, here + beside, behind + beside, behind + segment))
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    mesh.polygons.foreach_set("use_smooth", [True] * len(faces))
    mesh.update()
    return mesh


def _iris_material(look: Look, radius: float) -> Any:
    graph = Graph("eye")
    coordinates = graph.add("TexCoord").outputs["Object"]
    separate = graph.add("SeparateXYZ")
    graph.set(separate.inputs[0], coordinates)
    x, y, z = separate.outputs
    from_axis = graph.math("SQRT", graph.math("ADD", graph.times(x, x), graph.times(z, z)))
    edge = graph.math("DIVIDE", from_axis, radius * math.sin(IRIS))  # 1 at the edge of the iris
    angle = graph.math("ARCTAN2", z, x)
    behind = graph.math("GREATER_THAN", y, 0.0)
    spokes = graph.add("CombineXYZ")
    for index, value in enumerate(
        (graph.times(graph.math("COSINE", angle), 7.0), graph.times(graph.math("SINE", angle), 7.0))
    ):
        graph.set(spokes.inputs[index], value)
    graph.set(spokes.inputs[2], graph.times(edge, 1.1))
    colours = graph.add("ValToRGB")
    dark, light = colours.color_ramp.elements
    dark.position, dark.color = 0.32, (*(value * 0.30 for value in look.iris), 1)
    light.position, light.color = 0.70, (*(min(1, value * 1.9) for value in look.iris), 1)
    graph.set(colours.inputs[0], graph.noise(2.2, 5, at=spokes.outputs[0]))
    iris = graph.mix(graph.soft_ramp(edge, 0.75, 1.0), colours.outputs[0], (0.03, 0.022, 0.018))
    iris = graph.mix(graph.soft_ramp(edge, 0.50, 0.30), iris, tuple(value * 1.2 for value in look.iris_inner))
    iris = graph.mix(graph.soft_ramp(edge, 0.40, 0.36), iris, (0.003, 0.003, 0.003))
    white = graph.mix(graph.soft_ramp(edge, 1.2, 2.3), (0.60, 0.55, 0.52), (0.50, 0.36, 0.32))
    veins = graph.times(graph.soft_ramp(graph.noise(180, 6, at=coordinates), 0.55, 0.7), 0.30)
    white = graph.mix(veins, white, (0.62, 0.30, 0.26))
    limbus = graph.soft_ramp(graph.math("ADD", edge, graph.times(behind, 9)), 0.93, 1.10)
    shader = graph.principled(
        base_color=graph.mix(limbus, iris, white),
        roughness=0.5,
        specular_ior_level=0.1,
        subsurface_weight=0.25,
        subsurface_scale=0.001,
    )
    return graph.surface(shader.outputs[0])


def _cornea_material() -> Any:
    """Clear but for its reflections."""
    graph = Graph("cornea")
    glossy, clear, fresnel, mixed = (
        graph.add(kind) for kind in ("BsdfGlossy", "BsdfTransparent", "Fresnel", "MixShader")
    )
    glossy.inputs["Roughness"].default_value = 0.05
    fresnel.inputs[0].default_value = 1.55
    for index, value in enumerate((fresnel.outputs[0], clear.outputs[0], glossy.outputs[0])):
        graph.set(mixed.inputs[index], value)
    return graph.surface(mixed.outputs[0])
