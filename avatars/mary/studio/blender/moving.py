# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""A short clip of Mary speaking while her head moves, with the motion known exactly: the measure for stabilisation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.blender.figure import Figure
from avatars.mary.studio.blender.shots import build, spoken
from avatars.mary.studio.blender.stage import Stage
from avatars.mary.studio.blender.surface import SurfacePoints
from avatars.mary.studio.boxes import FRAME
from avatars.mary.studio.camera import Camera
from avatars.mary.studio.claims import claimed
from avatars.mary.studio.head import pivot, turned
from avatars.mary.studio.landmarks import LIPS, pixels, rounded
from avatars.mary.studio.motion import MOVING_FRAMES, Motion, moving_motion
from avatars.mary.studio.workspace import FPS, Mouths, Workspace, write_json

Array = NDArray[np.float64]

FIRST_SPOKEN = 16
"""Frame of the recording that the clip's first mouth is from: from there on lips close and open, round and tuck in."""

NOTE = (
    "l/r = her left/right; pixels with 0 at the upper left corner of the picture (centres of pixels are at halves), "
    "y down; head rotation R = Ry(yaw) Rx(pitch) Rz(roll) in degrees about the pivot; then the whole figure goes by "
    "`place` (dm; x to her left, y up, z nearer), which is done by moving the camera the other way (the backdrop "
    "stays); scale = how much larger than in the neutral picture things at the pivot's depth are. landmarks: of the "
    "lips as they are, of the face as the skull carries them; surface: all as the skin is rendered; camera: view takes "
    "(x, -z, y) / 10, metres, to the camera, which looks along -z, and focal is the focal length over the picture's "
    "width; points_dm: the landmarks at rest"
)


def render_moving(data: Path, workspace: Workspace, size: int, samples: int, threads: int) -> None:
    """Render the clip's frames, square of `size` pixels, and write where the head and its landmarks are in each."""
    stage, figure = build(data, workspace, threads)
    mouths = workspace.read_mouths()
    figure.pose({})
    home = stage.camera()
    points = SurfacePoints(figure.body, home, pixels(home), FRAME)
    rest = points.where()
    poses = []
    for frame in range(MOVING_FRAMES):
        motion = moving_motion(frame)
        _place(stage, figure, motion, mouths, frame)
        poses.append(_described(frame, motion, home, stage, figure, points, rest, size))
        with claimed(workspace.moving(frame)) as ours:
            if ours:
                stage.quality(samples=samples, fine=True)
                stage.render(workspace.moving(frame), size)
    neutral, _ = home.project(rest, size)
    content = {
        "fps": FPS,
        "frames": MOVING_FRAMES,
        "size": size,
        "pivot_dm": pivot(figure.face.neck).tolist(),
        "recording_frames": [FIRST_SPOKEN, FIRST_SPOKEN + MOVING_FRAMES],
        "note": NOTE,
        "camera": {"view": home.view.tolist(), "focal": home.focal},
        "points_dm": dict(zip(points.names, rest.round(5).tolist(), strict=True)),
        "neutral": rounded(points.names, neutral),
        "poses": poses,
    }
    write_json(workspace.moving_pose, content)


def _place(stage: Stage, figure: Figure, motion: Motion, mouths: Mouths, frame: int) -> None:
    expression = figure.face.look.expression
    speaking = spoken(mouths, FIRST_SPOKEN + frame, expression)
    figure.pose(speaking | motion.controls(expression), motion.head)
    stage.place_camera(-np.array(motion.place))


def _described(
    frame: int,
    motion: Motion,
    home: Camera,
    stage: Stage,
    figure: Figure,
    points: SurfacePoints,
    rest: Array,
    size: int,
) -> dict[str, Any]:
    """What pose.json says of a frame, which Blender's scene shows now; rest (n, 3): the points at rest, dm."""
    head, neck, camera = motion.head, figure.face.neck, stage.camera()
    surface, _ = camera.project(points.where(), size)
    skull, _ = camera.project(turned(rest, head, neck), size)
    depths = [view.project(pivot(neck), size)[1] for view in (home, camera)]
    lips = np.array([name in LIPS for name in points.names])[:, None]
    return {
        "frame": frame,
        "yaw": round(head.yaw, 4),
        "pitch": round(head.pitch, 4),
        "roll": round(head.roll, 4),
        "place": [round(distance, 5) for distance in motion.place],
        "scale": round(float(depths[0] / depths[1]), 5),
        "blink": motion.blink,
        "landmarks": rounded(points.names, np.where(lips, surface, skull)),
        "surface": rounded(points.names, surface),
    }
