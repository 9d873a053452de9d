# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""The skin's graph turned into two pictures: a frame takes half to a third of the time, and has less noise."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy

from avatars.mary.studio.blender.nodes import Graph

SIZE = 4096  # pixels
HEIGHT_UNIT = 1000  # stored heights are millimetres


def bake_skin(body: Any, folder: Path) -> None:
    """Replace the skin of the body by one that reads its colour, roughness and height from pictures.

    Args:
        body: Blender's object; its material is that of `skin.skin_material`.
        folder: keeps the pictures, which take a minute or two to make; if they are there they are taken.
    """
    material = body.data.materials[0]
    tree = material.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    emission = tree.nodes.new("ShaderNodeEmission")
    both = tree.nodes.new("ShaderNodeCombineColor")
    tree.links.new(_height(tree, shader), both.inputs[0])
    tree.links.new(_source(tree, shader.inputs["Roughness"]), both.inputs[1])
    for thing in bpy.data.objects:
        thing.select_set(thing == body)
    bpy.context.view_layer.objects.active = body
    cycles = bpy.context.scene.cycles
    samples, cycles.samples = cycles.samples, 1
    images: list[Any] = []
    for name, socket in (
        ("colour", _source(tree, shader.inputs["Base Color"])),
        ("height_roughness", both.outputs[0]),
    ):
        path = folder / f"{name}.exr"
        if path.exists():
            image = bpy.data.images.load(str(path))
        else:
            tree.links.new(socket, emission.inputs[0])
            tree.links.new(emission.outputs[0], output.inputs[0])
            material.update_tag()
            bpy.context.view_layer.update()
            image = _baked(tree, name, warm_up=not images)
            folder.mkdir(parents=True, exist_ok=True)
            partial = path.with_name(f"{name}.part.exr")  # another process may be looking for the picture
            image.filepath_raw, image.file_format = str(partial), "OPEN_EXR"
            image.save()
            partial.rename(path)
            image.filepath_raw = str(path)
        image.colorspace_settings.name = "sRGB"  # the baked buffers are stored sRGB-encoded
        images.append(image)
    cycles.samples = samples
    tree.links.new(shader.outputs[0], output.inputs[0])
    body.data.materials[0] = _picture_material(shader, *images)


def _source(tree: Any, socket: Any) -> Any:
    """The output that feeds an input, or None."""
    return next((link.from_socket for link in tree.links if link.to_socket == socket), None)


def _height(tree: Any, shader: Any) -> Any:
    """The output that adds up the heights of all bumps of a shader, in millimetres."""
    total = None
    normal = _source(tree, shader.inputs["Normal"])
    while normal is not None:
        bump = normal.node
        metres, height = tree.nodes.new("ShaderNodeMath"), tree.nodes.new("ShaderNodeMath")
        metres.operation = height.operation = "MULTIPLY"
        tree.links.new(_source(tree, bump.inputs["Height"]), metres.inputs[0])
        metres.inputs[1].default_value = bump.inputs["Distance"].default_value * HEIGHT_UNIT
        tree.links.new(metres.outputs[0], height.inputs[0])
        strength = _source(tree, bump.inputs["Strength"])
        if strength is None:
            height.inputs[1].default_value = bump.inputs["Strength"].default_value
        else:
            tree.links.new(strength, height.inputs[1])
        if total is None:
            total = height.outputs[0]
        else:
            add = tree.nodes.new("ShaderNodeMath")
            tree.links.new(total, add.inputs[0])
            tree.links.new(height.outputs[0], add.inputs[1])
            total = add.outputs[0]
        normal = _source(tree, bump.inputs["Normal"])
    return total


def _baked(tree: Any, name: str, *, warm_up: bool) -> Any:
    """A new picture of what the material emits."""
    image = bpy.data.images.new(name, SIZE, SIZE, float_buffer=True)
    target = tree.nodes.new("ShaderNodeTexImage")
    target.image = image
    if warm_up:  # the first bake after the graph has changed still sees the old graph
        small = tree.nodes.new("ShaderNodeTexImage")
        small.image = bpy.data.images.new("warm up", 64, 64)
        tree.nodes.active = small
        bpy.ops.object.bake(type="EMIT", margin=0)
    tree.nodes.active = target
    bpy.ops.object.bake(type="EMIT", margin=8, use_clear=True)
    return image


def _picture_material(procedural: Any, colour: Any, height_roughness: Any) -> Any:
    """A skin like the procedural shader's that reads the pictures."""
    graph = Graph("skin from pictures")
    shader = graph.add("BsdfPrincipled")
    for socket in procedural.inputs:
        if socket.name in shader.inputs and not socket.is_linked and hasattr(socket, "default_value"):
            with suppress(TypeError, AttributeError):
                shader.inputs[socket.name].default_value = socket.default_value
    shader.subsurface_method = "RANDOM_WALK_SKIN"
    graph.set(shader.inputs["Base Color"], graph.add("TexImage", image=colour).outputs[0])
    parts = graph.add("SeparateColor")
    graph.set(parts.inputs[0], graph.add("TexImage", image=height_roughness).outputs[0])
    graph.set(shader.inputs["Roughness"], parts.outputs[1])
    graph.set(shader.inputs["Normal"], graph.bump(parts.outputs[0], 0.6, 0.001))
    return graph.surface(shader.outputs[0])
