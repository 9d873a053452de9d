"""How the head moves when it is not at rest: the idle loop, and the clip with a known motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from avatars.mary.studio.head import HeadPose
from avatars.mary.studio.visemes import both_sides
from avatars.mary.studio.workspace import FPS

IDLE_FRAMES = 125  # the loop's length; frame 125 is frame 0
IDLE_BLINKS = (34, 96)  # frames
MOVING_FRAMES = 48
MOVING_BLINK = 27  # frame
BLINK_LEVELS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)  # closures that are rendered for the idle loop
_BLINK = {-2: 0.35, -1: 0.92, 0: 1.0, 1: 0.80, 2: 0.48, 3: 0.20, 4: 0.06}  # closure by frames from the middle


@dataclass(frozen=True)
class Motion:
    """One frame's motion.

    Attributes:
        head: how it is turned, and where the eyes look.
        blink: 0 open, 1 closed.
        breath: metres that the shoulders are lifted.
        brows: added to the inner brows.
        place: dm, where the whole figure has gone (x to her left, y up, z nearer).
    """

    head: HeadPose
    blink: float = 0.0
    breath: float = 0.0
    brows: float = 0.0
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def controls(self, expression: Mapping[str, float]) -> dict[str, float]:
        """Face units of lids and brows, from those at rest."""
        return blink_controls(self.blink, expression) | {"browInnerUp": expression["browInnerUp"] + self.brows}


def blink_controls(closure: float, expression: Mapping[str, float]) -> dict[str, float]:
    """Face units of the lids; eyes that are wide open at rest give that up as they close."""
    wide = {name: weight * (1 - closure) for name, weight in expression.items() if name.startswith("eyeWide")}
    return both_sides({"eyeBlink": closure}) | wide


def idle_motion(frame: int) -> Motion:
    """Sway, nod, breathing and blinks of a frame of the loop; she keeps looking at the camera."""
    blinks = {middle + offset: closure for middle in IDLE_BLINKS for offset, closure in _BLINK.items()}
    turn = 2 * math.pi * frame / IDLE_FRAMES
    yaw = 1.7 * math.sin(turn) + 0.45 * math.sin(2 * turn + 0.8)
    pitch = 0.75 * math.sin(turn + 1.9) + 0.30 * math.sin(3 * turn + 0.3)
    roll = 0.65 * math.sin(turn + 0.7) + 0.25 * math.sin(2 * turn + 2.1)
    head = HeadPose(yaw, pitch, roll, gaze_across=-yaw + 0.25 * math.sin(2 * turn), gaze_up=pitch)
    return Motion(
        head,
        blink=blinks.get(frame % IDLE_FRAMES, 0.0),
        breath=0.0010 * math.sin(2 * turn),
        brows=0.04 * (1 + math.sin(2 * turn)),
    )


def moving_motion(frame: int) -> Motion:
    """The moving head: yaw within 5, pitch 4, roll 3 degrees; 0.06 dm across and down, 0.23 dm (3 %) nearer or away."""

    def wave(amplitude: float, hertz: float, phase: float) -> float:
        return amplitude * math.sin(2 * math.pi * (hertz * frame / FPS + phase))

    yaw, pitch, roll = wave(5.0, 0.62, 0.02), wave(4.0, 0.85, 0.30), wave(3.0, 0.55, 0.62)
    head = HeadPose(yaw, pitch, roll, gaze_across=-yaw, gaze_up=pitch)
    place = (wave(0.06, 0.70, 0.15), wave(0.05, 0.55, 0.40), wave(0.23, 0.60, 0.75))
    return Motion(head, blink=_BLINK.get(frame - MOVING_BLINK, 0.0), place=place)
