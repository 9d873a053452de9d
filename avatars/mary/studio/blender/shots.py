# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""What is rendered of the recording, in which order, and how well."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from avatars.mary.studio.blender.figure import AT_REST, Figure
from avatars.mary.studio.blender.skin_bake import bake_skin
from avatars.mary.studio.blender.stage import Stage
from avatars.mary.studio.boxes import EYES, FRAME, MOUTH, Box
from avatars.mary.studio.claims import claimed
from avatars.mary.studio.face import Controls, Face
from avatars.mary.studio.head import HeadPose
from avatars.mary.studio.look import MARY
from avatars.mary.studio.motion import BLINK_LEVELS, IDLE_FRAMES, blink_controls, idle_motion
from avatars.mary.studio.visemes import SMILE, VISEMES
from avatars.mary.studio.workspace import Mouths, Workspace


@dataclass(frozen=True)
class Shot:
    """One picture.

    Attributes:
        path: of the file.
        controls: of the face.
        samples: a pixel.
        head: its turn.
        box: the part of the frame, or all of it.
        fine: let the denoiser take its time.
        breath: metres that the shirt is lifted.
    """

    path: Path
    controls: Controls
    samples: int
    head: HeadPose = AT_REST
    box: Box | None = None
    fine: bool = False
    breath: float = 0.0


def build(data: Path, workspace: Workspace, threads: int) -> tuple[Stage, Figure]:
    """Stage and figure, ready to render; the first time it takes a minute or two longer, for the skin."""
    stage, face = Stage(threads), Face(data, MARY)
    figure = Figure(face, data)
    stage.furnish(face)
    bake_skin(figure.body, workspace.bake)
    return stage, figure


def shots(workspace: Workspace, kinds: Sequence[str], frames: range | None = None) -> Iterator[Shot]:
    """All pictures of the kinds, in their order; of the recording's frames only some, if `frames` is given.

    The kind `idle` is for comparison only: the loop is made from the still.
    """
    expression = MARY.expression
    for kind in kinds:
        if kind == "still":
            yield Shot(workspace.still, {}, 64, fine=True)
        elif kind == "smile":
            yield Shot(workspace.smile, SMILE, 24, fine=True)
        elif kind == "blink":
            for level, closure in enumerate(BLINK_LEVELS):
                yield Shot(workspace.blink(level), blink_controls(closure, expression), 10, box=EYES)
        elif kind == "mouth":
            mouths = workspace.read_mouths()
            same = mouths.representatives()
            for frame in dict.fromkeys(same[frame] for frame in frames or range(len(same))):
                yield Shot(workspace.mouth(frame), spoken(mouths, frame, expression), 5, box=MOUTH)
        elif kind == "visemes":
            for name, controls in VISEMES.items():
                yield Shot(workspace.viseme(name), controls, 5, box=MOUTH)
        elif kind == "idle":
            for frame in range(IDLE_FRAMES):
                motion = idle_motion(frame)
                path, controls = workspace.rendered_idle(frame), motion.controls(expression)
                yield Shot(path, controls, 5, motion.head, breath=motion.breath)


def spoken(mouths: Mouths, frame: int, expression: Controls) -> dict[str, float]:
    """A frame's controls; speaking never takes away from the expression at rest."""
    return {name: max(expression.get(name, 0.0), weight) for name, weight in mouths.controls(frame).items()}


def render(data: Path, workspace: Workspace, kinds: Sequence[str], frames: range | None, threads: int) -> None:
    """Render what is missing. May run several times at once, and be stopped and started again."""
    stage, figure = build(data, workspace, threads)
    for shot in shots(workspace, kinds, frames):
        with claimed(shot.path) as ours:
            if not ours:
                continue
            figure.only_mouth(shot.box is MOUTH)
            figure.breathe(shot.breath)
            figure.pose(shot.controls, shot.head)
            stage.quality(samples=shot.samples, fine=shot.fine)
            stage.render(shot.path, FRAME, shot.box)
