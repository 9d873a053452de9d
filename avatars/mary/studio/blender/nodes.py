# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""A small language for Blender's shader graphs: a value is a number, a colour, or the output of another node."""

from __future__ import annotations

from typing import Any

import bpy

Value = Any
"""float, (r, g, b), or a node's output socket."""


class Graph:
    """A new material and its empty graph."""

    def __init__(self, name: str) -> None:
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()
        self.output = self.add("OutputMaterial")

    def add(self, kind: str, **properties: Any) -> Any:
        """A node of the kind `ShaderNode…`."""
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in properties.items():
            setattr(node, name, value)
        return node

    def set(self, socket: Any, value: Value) -> None:
        """Give an input a value."""
        if isinstance(value, int | float):
            socket.default_value = value
        elif isinstance(value, tuple):
            socket.default_value = value if len(value) == len(socket.default_value) else (*value, 1)
        else:
            self.tree.links.new(value, socket)

    def surface(self, shader: Any) -> Any:
        """Make a shader's output what the material shows; returns the material."""
        self.tree.links.new(shader, self.output.inputs[0])
        return self.material

    def math(self, operation: str, *values: Value) -> Any:
        """One operation on numbers."""
        node = self.add("Math", operation=operation)
        for socket, value in zip(node.inputs, values, strict=False):
            self.set(socket, value)
        return node.outputs[0]

    def times(self, *values: Value) -> Any:
        """The product of two numbers."""
        return self.math("MULTIPLY", *values)

    def mix(self, share: Value, first: Value, second: Value, blend: str = "MIX") -> Any:
        """A colour between two, or their product."""
        node = self.add("Mix", data_type="RGBA", blend_type=blend)
        for index, value in ((0, share), (6, first), (7, second)):
            self.set(node.inputs[index], value)
        return node.outputs[2]

    def between(self, share: Value, first: Value, second: Value) -> Any:
        """A number between two."""
        node = self.add("Mix", data_type="FLOAT")
        for index, value in ((0, share), (2, first), (3, second)):
            self.set(node.inputs[index], value)
        return node.outputs[0]

    def ramp(self, value: Value, start: float, end: float, low: float = 0.0, high: float = 1.0) -> Any:
        """`low` up to `start`, `high` from `end` on, straight between."""
        node = self.add("MapRange")
        for index, number in enumerate((value, start, end, low, high)):
            self.set(node.inputs[index], number)
        return node.outputs[0]

    def soft_ramp(self, value: Value, start: float, end: float) -> Any:
        """0 to 1, smooth at both ends."""
        node = self.add("MapRange", interpolation_type="SMOOTHSTEP")
        for index, number in enumerate((value, start, end)):
            self.set(node.inputs[index], number)
        return node.outputs[0]

    def attribute(self, name: str, output: str = "Fac") -> Any:
        """What a mesh says of each vertex."""
        return self.add("Attribute", attribute_name=name).outputs[output]

    def noise(self, scale: float, detail: float | None = None, roughness: float | None = None, *, at: Value) -> Any:
        """Smooth noise at a place."""
        node = self.add("TexNoise")
        for name, value in (("Scale", scale), ("Detail", detail), ("Roughness", roughness)):
            if value is not None:
                node.inputs[name].default_value = value
        self.set(node.inputs["Vector"], at)
        return node.outputs[0]

    def cells(self, scale: float, *, at: Value) -> Any:
        """Distance to the nearest of randomly scattered points."""
        node = self.add("TexVoronoi")
        node.inputs["Scale"].default_value = scale
        self.set(node.inputs["Vector"], at)
        return node.outputs["Distance"]

    def bump(self, height: Value, strength: Value, distance: float, normal: Value = None) -> Any:
        """A normal, tilted by a height in units of `distance` metres."""
        node = self.add("Bump")
        self.set(node.inputs["Strength"], strength)
        node.inputs["Distance"].default_value = distance
        self.set(node.inputs["Height"], height)
        if normal is not None:
            self.set(node.inputs["Normal"], normal)
        return node.outputs[0]

    def principled(self, **inputs: Value) -> Any:
        """Blender's general surface; `base_color=` sets the input `Base Color`, and so on. Returns the node."""
        node = self.add("BsdfPrincipled")
        names = {socket.name.lower().replace(" ", "_"): socket for socket in node.inputs}
        for name, value in inputs.items():
            self.set(names[name], value)
        return node


def plain(
    name: str,
    colour: tuple[float, float, float],
    *,
    roughness: float,
    subsurface: float = 0,
    scatter: float = 0.002,
    radius: tuple[float, float, float] = (1, 0.3, 0.2),
    specular: float = 0.5,
    bump: float = 0,
    bump_scale: float = 500,
) -> Any:
    """A material of one colour, with an uneven surface if `bump` is not 0; `scatter` is in metres."""
    graph = Graph(name)
    shader = graph.principled(
        base_color=colour,
        roughness=roughness,
        subsurface_weight=subsurface,
        subsurface_scale=scatter,
        subsurface_radius=radius,
        specular_ior_level=specular,
        coat_roughness=0.1,
    )
    if bump:
        place = graph.add("TexCoord").outputs["Object"]
        graph.set(shader.inputs["Normal"], graph.bump(graph.noise(bump_scale, at=place), bump, 0.001))
    return graph.surface(shader.outputs[0])
