# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""The skin: where it is red, dark or yellow, its pores and lines, lips, and the skin under the hair."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.blender.nodes import Graph
from avatars.mary.studio.blender.objects import to_blender
from avatars.mary.studio.face import Face

Array = NDArray[np.float64]


def add_tints(mesh: Any, face: Face, vertices: Array) -> None:
    """Give the body's mesh what the skin's graph asks for: places at rest, and masks `red`, `dark`, `yellow`, `scalp`.

    Args:
        mesh: Blender's mesh.
        face: hers.
        vertices: (n, 3) of the mesh, dm.
    """
    places = mesh.attributes.new("rest", "FLOAT_VECTOR", "POINT")
    places.data.foreach_set("vector", to_blender(vertices).astype(np.float32).ravel())
    across, height, depth = np.abs(vertices[:, 0]), vertices[:, 1] - face.eyes, vertices[:, 2] - face.left_eye[2]

    def spot(x: float, y: float, width: float, tall: float, behind: float) -> Array:
        shape: Array = np.exp(-(((across - x) / width) ** 2) - ((height - y) / tall) ** 2) * (depth > behind)
        return shape

    cheeks, nose = spot(0.42, -0.42, 0.24, 0.2, -0.3), spot(0, -0.40, 0.13, 0.12, 0.1)
    chin, lids = spot(0, -0.9, 0.2, 0.12, 0.0), spot(0.25, -0.05, 0.2, 0.06, 0.0)
    ears = (across > 0.68) * (np.abs(height + 0.15) < 0.45) * (depth < -0.6)
    under_eyes, eye_sockets = spot(0.24, -0.12, 0.17, 0.08, 0.0), spot(0.33, 0.12, 0.22, 0.1, 0)
    masks = {
        "red": 0.75 * cheeks + 0.9 * nose + 0.35 * chin + 0.3 * lids + 0.7 * ears,
        "dark": 0.55 * under_eyes + 0.35 * eye_sockets,
        "yellow": 0.8 * spot(0, 0.6, 0.5, 0.3, -0.4),
        "scalp": scalp(face, vertices),
    }
    for name, mask in masks.items():
        mesh.attributes.new(name, "FLOAT", "POINT").data.foreach_set("value", np.clip(mask, 0, 1).astype(np.float32))


def scalp(face: Face, vertices: Array) -> Array:
    """(n,) 1 over the hairline, 0 under it."""
    height = vertices[:, 1] - face.eyes
    over = np.clip((height - face.hairline(face.azimuth(vertices))) / 0.08 + 0.5, 0, 1)
    mask: Array = over * (vertices[:, 1] > face.neck[1] + 0.2)
    return mask


def skin_material(face: Face, data: Path) -> Any:
    """The skin as a graph of noise: slow to render, so `skin_bake` makes pictures of it."""
    look, graph = face.look, Graph("skin")
    place = graph.attribute("rest", "Vector")

    def noise(scale: float, detail: float = 4, roughness: float = 0.6) -> Any:
        return graph.noise(scale, detail, roughness, at=place)

    def mask(file: str, start: float, end: float) -> Any:
        image = bpy.data.images.load(str(data / "mpfb2/textures" / file))
        image.colorspace_settings.name = "Non-Color"
        return graph.ramp(graph.add("TexImage", image=image).outputs[0], start, end)

    colour = graph.mix(graph.ramp(noise(75, 7, 0.72), 0.38, 0.62), look.skin, look.skin_patches)
    colour = graph.mix(graph.times(graph.ramp(noise(22, 3), 0.3, 0.7), 0.35), colour, look.skin_red)
    colour = graph.mix(graph.times(graph.attribute("red"), 0.72), colour, look.skin_red)
    colour = graph.mix(graph.times(graph.attribute("yellow"), 0.3), colour, look.skin_yellow)
    colour = graph.mix(graph.times(graph.attribute("dark"), 0.45), colour, look.skin_dark)
    spots = graph.ramp(graph.cells(330, at=place), 0.12, 0.30, 1, 0)
    freckles = graph.times(spots, graph.ramp(noise(45, 2), 0.52, 0.66))
    colour = graph.mix(graph.times(freckles, look.freckles), colour, look.skin_dark)
    mottling = graph.times(graph.ramp(noise(420, 3), 0.35, 0.65), 0.18)
    colour = graph.mix(mottling, colour, look.skin_dark)

    lips, inside = mask("mpfb_lips.jpg", 0.25, 0.8), mask("mpfb_inside-mouth.jpg", 0.3, 0.7)
    stretched = graph.add("Mapping")
    stretched.inputs["Scale"].default_value = (900, 900, 120)  # lines that run up and down the lips
    graph.set(stretched.inputs["Vector"], place)
    lip_lines = graph.noise(1, 3, 0.6, at=stretched.outputs[0])
    lip_colour = graph.mix(graph.ramp(lip_lines, 0.3, 0.7), look.lip, look.lip_patches)
    colour = graph.mix(graph.times(lips, look.lip_share), colour, lip_colour)
    colour = graph.mix(inside, colour, (0.32, 0.07, 0.06))
    colour = graph.mix(graph.times(graph.attribute("scalp"), 0.9), colour, look.scalp)

    roughness = graph.between(lips, graph.ramp(noise(90, 4), 0.3, 0.7, 0.40, 0.56), 0.34)
    pores = graph.math("ADD", graph.cells(900, at=place), noise(1100, 3))
    normal = graph.bump(pores, 0.4, 0.0007)
    normal = graph.bump(noise(160, 4), 0.5, 0.0016, normal)
    normal = graph.bump(lip_lines, graph.times(lips, 0.7), 0.0009, normal)
    shader = graph.principled(
        base_color=colour,
        roughness=graph.between(inside, roughness, 0.25),
        specular_ior_level=0.42,
        subsurface_weight=1.0,
        subsurface_radius=(1.0, 0.30, 0.16),
        subsurface_scale=0.0035,
        subsurface_ior=1.4,
        normal=normal,
    )
    shader.subsurface_method = "RANDOM_WALK_SKIN"
    return graph.surface(shader.outputs[0])
