"""Twenty-two named points of the face: where they are in the picture at rest, and from that on the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.boxes import FRAME
from avatars.mary.studio.camera import Camera

Array = NDArray[np.float64]

NEAR: dict[str, tuple[float, float, float]] = {
    "nose_tip": (0.008, 6.509, 1.592),
    "nose_base": (0.009, 6.408, 1.512),
    "nose_bridge": (0.003, 6.72, 1.45),
    "nostril_l": (0.12, 6.44, 1.45),
    "nostril_r": (-0.11, 6.44, 1.45),
    "eye_l_in": (0.1385, 6.785, 1.235),
    "eye_l_out": (0.4585, 6.79, 1.175),
    "eye_r_in": (-0.1385, 6.785, 1.235),
    "eye_r_out": (-0.4585, 6.79, 1.175),
    "brow_l": (0.30, 7.01, 1.35),
    "brow_r": (-0.30, 7.01, 1.35),
    "cheek_l": (0.45, 6.35, 1.15),
    "cheek_r": (-0.45, 6.35, 1.15),
    "jaw_l": (0.48, 6.02, 0.85),
    "jaw_r": (-0.48, 6.02, 0.85),
    "forehead": (0, 7.3, 1.41),
    "mouth_l": (0.245, 6.200, 1.28),
    "mouth_r": (-0.228, 6.196, 1.28),
    "lip_top": (0.008, 6.261, 1.48),
    "lip_mid": (0.008, 6.187, 1.41),
    "lip_bottom": (0.008, 6.088, 1.409),
    "chin": (0.006, 5.869, 1.326),
}
"""About where, dm in MakeHuman's frame; l and r are her left and right. The landmark is what the pixel there shows."""

LIPS = ("mouth_l", "mouth_r", "lip_top", "lip_mid", "lip_bottom")
"""Those that speaking moves; the others are taken as fixed to the skull."""


def pixels(camera: Camera) -> dict[str, tuple[int, int]]:
    """Column and row of the pixel in the frame at rest that defines each landmark."""
    projected, _ = camera.project(np.array(list(NEAR.values())), FRAME)
    return {name: (round(float(x)), round(float(y))) for name, (x, y) in zip(NEAR, projected, strict=True)}


def rounded(names: list[str], points: Array) -> dict[str, list[float]]:
    """Projected points (n, 2) by name, to a hundredth of a pixel."""
    return {name: [round(float(x), 2), round(float(y), 2)] for name, (x, y) in zip(names, points, strict=True)}
