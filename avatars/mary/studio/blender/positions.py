# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""Where in space each pixel of the still is, and what it shows: what the idle loop is made from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.blender.figure import Figure
from avatars.mary.studio.blender.nodes import Graph
from avatars.mary.studio.blender.objects import from_blender
from avatars.mary.studio.blender.stage import Stage
from avatars.mary.studio.boxes import FRAME
from avatars.mary.studio.face import Face
from avatars.mary.studio.look import MARY
from avatars.mary.studio.workspace import Workspace

OFFSET = 10.0  # m, added so that no coordinate is negative: light is not
PARTS = ("shirt", "body", "head")
"""What a pixel can show; hair, eyes and all else that goes along with the head is `head`."""


def write_positions(data: Path, workspace: Workspace, threads: int) -> None:
    """Two cheap passes of the pose at rest.

    The file holds `position` (H, W, 3), dm in MakeHuman's frame, NaN on the backdrop; `cover` (H, W), 0..1; `part`
    (H, W), numbers into `PARTS`; `view` and `focal` of the camera; `neck` (3,).
    """
    stage, face = Stage(threads), Face(data, MARY)
    figure = Figure(face, data)
    stage.furnish(face)
    figure.pose({})
    stage.show_data()
    raw = _pass(stage, _position_material(), 1, 0.01, workspace.root / "position.exr")
    hit = raw[..., 3] > 0.5
    position = np.where(hit[..., None], from_blender(raw[..., :3].astype(np.float64) - OFFSET), np.nan)
    parts = figure.parts()
    for thing in bpy.data.objects:
        named = next((at for at, name in enumerate(PARTS[:2]) if thing in parts[name]), 2)
        thing.color = (*(float(at == named) for at in range(3)), 1)
    seen = _pass(stage, _part_material(), 24, 1.5, workspace.root / "part.exr")
    camera = stage.camera()
    np.savez_compressed(
        workspace.positions,
        position=position,
        cover=np.clip(seen[..., 3], 0, 1),
        part=seen[..., :3].argmax(-1).astype(np.uint8),
        view=camera.view,
        focal=camera.focal,
        neck=face.neck,
    )


def _position_material() -> Any:
    graph = Graph("position")
    moved, glow = graph.add("VectorMath", operation="ADD"), graph.add("Emission")
    moved.inputs[1].default_value = (OFFSET, OFFSET, OFFSET)
    graph.set(moved.inputs[0], graph.add("NewGeometry").outputs["Position"])
    graph.set(glow.inputs[0], moved.outputs[0])
    return graph.surface(glow.outputs[0])


def _part_material() -> Any:
    graph = Graph("part")
    glow = graph.add("Emission")
    graph.set(glow.inputs[0], graph.add("ObjectInfo").outputs["Color"])
    return graph.surface(glow.outputs[0])


def _pass(stage: Stage, material: Any, samples: int, filter_width: float, path: Path) -> NDArray[np.float32]:
    """(H, W, 4) what the material emits, everything made of it; the filter's width is in pixels."""
    bpy.context.view_layer.material_override = material
    cycles = bpy.context.scene.cycles
    cycles.samples, cycles.filter_width = samples, filter_width
    stage.render(path, FRAME)
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    pixels = np.empty(FRAME * FRAME * 4, np.float32)
    image.pixels.foreach_get(pixels)
    path.unlink()
    return pixels.reshape(FRAME, FRAME, 4)[::-1]
