# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""What hair, brows and lashes are made of."""

from __future__ import annotations

from typing import Any

from avatars.mary.studio.blender.nodes import Graph
from avatars.mary.studio.look import Colour

COLOUR: Colour = (0.050, 0.027, 0.016)
SHINE: Colour = (0.20, 0.135, 0.09)
MELANIN = 0.86  # at which the colours are as written


def hair_material(name: str, melanin: float) -> Any:
    """Diffuse and shiny parts, every strand a little lighter or darker; far less noise than Blender's own hair."""
    graph = Graph(name)
    lightness = (1 - melanin) / (1 - MELANIN)
    diffuse, shiny = graph.add("BsdfDiffuse"), graph.add("BsdfHair", component="Reflection")
    strand = graph.add("MapRange")
    graph.set(strand.inputs[0], graph.add("HairInfo").outputs["Random"])
    graph.set(strand.inputs[3], 0.55)
    graph.set(strand.inputs[4], 1.35)
    for shader, colour in ((diffuse, COLOUR), (shiny, SHINE)):
        grey = graph.add("CombineColor")
        for channel in grey.inputs:
            graph.set(channel, strand.outputs[0])
        tinted = graph.mix(1, tuple(min(1, value * lightness) for value in colour), grey.outputs[0], "MULTIPLY")
        graph.set(shader.inputs["Color"], tinted)
    shiny.inputs["RoughnessU"].default_value, shiny.inputs["RoughnessV"].default_value = 0.28, 0.9
    mixed = graph.add("MixShader")
    for index, value in enumerate((0.42, diffuse.outputs[0], shiny.outputs[0])):
        graph.set(mixed.inputs[index], value)
    return graph.surface(mixed.outputs[0])
