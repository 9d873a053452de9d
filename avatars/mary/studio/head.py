"""How the head turns on the neck."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.smoothstep import smoothstep

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HeadPose:
    """Angles in degrees. The head turns by R = Ry(yaw) Rx(pitch) Rz(roll) about `pivot`; the gaze turns in the head.

    Attributes:
        yaw: to her left.
        pitch: downwards.
        roll: towards her right shoulder.
        gaze_across, gaze_up: of both eyes, relative to the head; the first to her left.
    """

    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    gaze_across: float = 0.0
    gaze_up: float = 0.0

    @property
    def rotation(self) -> Array:
        """(3, 3) for column vectors of MakeHuman's frame."""
        return about_y(self.yaw) @ about_x(self.pitch) @ about_z(self.roll)

    @property
    def gaze(self) -> Array:
        """(3, 3) rotation of an eyeball in the world."""
        return self.rotation @ about_y(self.gaze_across) @ about_x(-self.gaze_up)


def about_x(degrees: float) -> Array:
    """Rotation about the x axis."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])


def about_y(degrees: float) -> Array:
    """Rotation about the y axis."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])


def about_z(degrees: float) -> Array:
    """Rotation about the z axis."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def pivot(neck: Array) -> Array:
    """(3,) the point that stays when the head turns: a little over and in front of the neck joint."""
    centre: Array = neck + np.array([0, 0.25, 0.15])
    return centre


def head_weight(points: Array, neck: Array) -> Array:
    """How far points of the body (..., 3) go along with the head: 1 on it, 0 on the shoulders, between on the neck.

    The border rises to the back, so that the jaw belongs to the head and the nape to the neck.
    """
    height = points[..., 1] + 0.45 * np.maximum(0, points[..., 2] - 0.45)
    return smoothstep(neck[1] - 0.15, neck[1] + 0.55, height)


def turned(points: Array, pose: HeadPose, neck: Array, weight: Any = 1.0) -> Array:
    """Points (..., 3) after the head has turned, each by its weight (...)."""
    rotation = pose.rotation
    if np.allclose(rotation, np.eye(3)):
        return points
    centre = pivot(neck)
    moved = (points - centre) @ rotation.T + centre
    turned_points: Array = points + (moved - points) * np.asarray(weight)[..., None]
    return turned_points
