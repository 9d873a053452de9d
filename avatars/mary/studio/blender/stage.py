# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""Renderer, lamps, backdrop and camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from avatars.mary.studio.blender.nodes import Graph
from avatars.mary.studio.blender.objects import METRES, link, to_blender
from avatars.mary.studio.boxes import Box
from avatars.mary.studio.camera import Camera
from avatars.mary.studio.face import Face

Array = NDArray[np.float64]
FOCAL_LENGTH, SENSOR = 85, 36  # mm
FOCUS = 0.1  # dm in front of the picture's centre


class Stage:
    """The scene around her. Make it before anything else: it empties Blender's scene."""

    def __init__(self, threads: int) -> None:
        """Args: threads: to render with."""
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._scene = bpy.context.scene
        render, cycles = self._scene.render, self._scene.cycles
        render.engine, render.use_persistent_data = "CYCLES", True
        render.threads_mode, render.threads = "FIXED", threads
        cycles.device = "CPU"
        cycles.seed, cycles.use_animated_seed, cycles.sampling_pattern = 7, False, "TABULATED_SOBOL"
        cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
        cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
        cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 8, 3, 3
        cycles.transmission_bounces, cycles.transparent_max_bounces = 4, 8
        cycles.use_adaptive_sampling = False
        cycles.caustics_reflective = cycles.caustics_refractive = False
        cycles.sample_clamp_indirect = 3.0
        view = self._scene.view_settings
        view.view_transform, view.look, view.exposure = "Filmic", "Medium High Contrast", 0
        self._scene.cycles_curves.shape = "RIBBONS"

    def furnish(self, face: Face) -> None:
        """Lamps, backdrop and camera around a face."""
        look, eyes = face.look, face.eyes
        target = np.array([0, eyes - 0.42, face.left_eye[2] - 0.3])
        _lamp("key", (-6, eyes + 4.0, 12), target, 0.8, look.key, (1, 0.96, 0.91))
        _lamp("fill", (9, eyes + 0.5, 11), target, 1.4, look.fill, (0.92, 0.96, 1))
        _lamp("catch", (-3, eyes + 2.6, 11), target, 0.22, look.catch, (1, 1, 1))
        _lamp("right rim", (7, eyes + 6, -8), target, 0.6, look.rim_right, (1, 0.97, 0.93))
        _lamp("left rim", (-8, eyes + 4, -8), target, 0.6, look.rim_left, (0.95, 0.97, 1))
        world = bpy.data.worlds.new("world")
        self._scene.world = world
        world.use_nodes = True
        ambience = world.node_tree.nodes["Background"]
        ambience.inputs[0].default_value, ambience.inputs[1].default_value = (0.75, 0.8, 0.9, 1), look.ambience
        self.backdrop = _backdrop(look.backdrop_edge, look.backdrop_centre)
        distance = look.frame_height * FOCAL_LENGTH / SENSOR
        centre = np.array([0, eyes - look.frame_centre, face.left_eye[2] - 0.2])
        lens = bpy.data.cameras.new("camera")
        lens.lens, lens.sensor_width = FOCAL_LENGTH, SENSOR
        lens.dof.use_dof, lens.dof.aperture_fstop = True, 16
        self._camera = link("camera", lens)
        self._scene.camera = self._camera
        self._home, self._distance = centre + np.array([0, 0.2, distance]), distance
        self.place_camera(np.zeros(3))
        way = Vector(to_blender(centre)) - self._camera.location
        self._camera.rotation_euler = way.to_track_quat("-Z", "Y").to_euler()

    def place_camera(self, moved: Array) -> None:
        """Move the camera from its place by (3,) dm, without turning it; the focus stays on the face."""
        self._camera.location = Vector(to_blender(self._home + moved))
        self._camera.data.dof.focus_distance = (self._distance + moved[2] - FOCUS) * METRES

    def camera(self) -> Camera:
        """The camera as it stands, for projections outside Blender."""
        bpy.context.view_layer.update()
        view = np.array(self._camera.matrix_world.inverted())
        return Camera(view, self._camera.data.lens / self._camera.data.sensor_width)

    def quality(self, *, samples: int, fine: bool) -> None:
        """Samples a pixel, and how carefully the denoiser works."""
        cycles = self._scene.cycles
        cycles.samples = samples
        cycles.denoising_prefilter = "ACCURATE" if fine else "FAST"
        cycles.denoising_quality = "HIGH" if fine else "BALANCED"

    def show_data(self) -> None:
        """From now on render numbers instead of light: no backdrop, no denoiser, no lens blur, no tone curve."""
        cycles, view, file = self._scene.cycles, self._scene.view_settings, self._scene.render.image_settings
        cycles.use_denoising = False
        self._scene.render.film_transparent = True
        self.backdrop.hide_render = True
        self._camera.data.dof.use_dof = False
        view.view_transform, view.look = "Raw", "None"
        file.file_format, file.color_depth, file.color_mode = "OPEN_EXR", "32", "RGBA"

    def render(self, path: Path, size: int, box: Box | None = None) -> None:
        """Render a picture of `size` by `size` pixels, or a box of it, into a file; a stopped render leaves none."""
        render = self._scene.render
        render.resolution_x = render.resolution_y = size
        render.resolution_percentage = 100
        render.use_border = render.use_crop_to_border = box is not None
        if box is not None:
            render.border_min_x, render.border_max_x = box.x / size, (box.x + box.width) / size
            render.border_min_y, render.border_max_y = 1 - (box.y + box.height) / size, 1 - box.y / size
        partial = path.with_name(f"{path.stem}.part{path.suffix}")
        path.parent.mkdir(parents=True, exist_ok=True)
        render.filepath = str(partial)
        bpy.ops.render.render(write_still=True)
        partial.rename(path)


def _lamp(
    name: str, place: tuple[float, ...], target: Array, size: float, watts: float, colour: tuple[float, ...]
) -> None:
    """A round lamp of `size` metres at a place in dm, turned to the target."""
    lamp = bpy.data.lights.new(name, "AREA")
    lamp.shape, lamp.size, lamp.energy, lamp.color = "DISK", size, watts, colour
    thing = link(name, lamp)
    thing.location = Vector(to_blender(np.array(place)))
    way = Vector(to_blender(target)) - thing.location
    thing.rotation_euler = way.to_track_quat("-Z", "Y").to_euler()


def _backdrop(edge: tuple[float, ...], centre: tuple[float, ...]) -> Any:
    """A wall that glows a little brighter in the middle of the picture, wherever the camera is; it lights nothing."""
    mesh = bpy.data.meshes.new("backdrop")
    corners = np.array([(-30, -20, -14), (30, -20, -14), (30, 40, -14), (-30, 40, -14)])  # dm
    mesh.from_pydata(to_blender(corners).tolist(), [], [(0, 1, 2, 3)])
    wall = link("backdrop", mesh)
    graph = Graph("backdrop")
    mapping, gradient = graph.add("Mapping"), graph.add("TexGradient", gradient_type="SPHERICAL")
    mapping.inputs["Location"].default_value = (-0.5, -0.5, 0)
    graph.set(mapping.inputs[0], graph.add("TexCoord").outputs["Window"])
    graph.set(gradient.inputs[0], mapping.outputs[0])
    colours, glow = graph.add("ValToRGB"), graph.add("Emission")
    first, last = colours.color_ramp.elements
    first.color, last.color = (*edge, 1), (*centre, 1)
    graph.set(colours.inputs[0], gradient.outputs[0])
    graph.set(glow.inputs[0], colours.outputs[0])
    mesh.materials.append(graph.surface(glow.outputs[0]))
    wall.visible_diffuse = wall.visible_glossy = wall.visible_shadow = False
    return wall
