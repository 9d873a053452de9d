"""Teeth and gums, made from scratch: MakeHuman's helpers only say where the two arches are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.face import Face

Array = NDArray[np.float64]
Faces = list[tuple[int, ...]]

MILLIMETRE = 0.01  # dm
SIZE = 0.92  # of the measures below
# From the middle to the side: two incisors, canine, two premolars, two molars. Millimetres, and shares of thickness.
UPPER_WIDTHS, UPPER_HEIGHTS = (8.4, 6.6, 7.4, 6.8, 6.6, 9.6, 9.0), (9.8, 8.6, 9.6, 8.0, 7.4, 7.0, 6.6)
LOWER_WIDTHS, LOWER_HEIGHTS = (5.3, 5.8, 6.6, 6.8, 7.0, 10.4, 10.0), (8.6, 8.8, 9.4, 8.0, 7.4, 7.0, 6.6)
THICKNESSES = (0.065, 0.06, 0.075, 0.08, 0.085, 0.1, 0.1)  # dm
EDGES = (0.28, 0.28, 0.45, 0.75, 0.85, 0.95, 0.95)  # thickness at the edge over that at the gum
CANINE = 2
AROUND, ALONG = 20, 14  # vertices around a tooth, and steps from gum to edge
GUM_STEPS, GUM_AROUND = 90, 14


@dataclass(frozen=True)
class Jaw:
    """Vertices (n, 3) in dm and faces of a row of teeth and of its gum."""

    teeth: Array
    tooth_faces: Faces
    gum: Array
    gum_faces: Faces


def teeth(face: Face, noise: np.random.Generator) -> tuple[Jaw, Jaw]:
    """The upper and the lower jaw; no two teeth are alike."""
    upper = face.rest[face.mesh.members("helper-upper-teeth")]
    lower = face.rest[face.mesh.members("helper-lower-teeth")]
    widths, heights = (np.array(values) * MILLIMETRE * SIZE for values in (UPPER_WIDTHS, UPPER_HEIGHTS))
    edge = float(upper[np.abs(upper[:, 0]) < 0.06, 1].min()) - 0.075
    above = _jaw(_Arch.around(upper, 0.02), widths, heights * 1.15, edge, True, noise)
    widths, heights = (np.array(values) * MILLIMETRE * SIZE for values in (LOWER_WIDTHS, LOWER_HEIGHTS))
    edge = float(lower[np.abs(lower[:, 0]) < 0.06, 1].max()) - 0.055
    return above, _jaw(_Arch.around(lower, 0.04), widths * 0.98, heights, edge, False, noise)


@dataclass(frozen=True)
class _Arch:
    """A dental arch seen from above: half a superellipse.

    Attributes:
        points: (400, 2) x and z in dm, from her right to her left.
        length: (400,) way along it.
        back: z of its ends.
    """

    points: Array
    length: Array
    back: float

    @classmethod
    def around(cls, helper: Array, inset: float) -> _Arch:
        """The arch of a helper's vertices (n, 3), `inset` dm inside them."""
        half, front, back = np.abs(helper[:, 0]).max() - inset, helper[:, 2].max() - inset, helper[:, 2].min()
        angle = np.linspace(-1, 1, 400) * math.pi / 2
        x = half * _power(np.sin(angle), 0.80)
        z = back + (front - back) * np.abs(np.cos(angle)) ** 0.80
        points = np.c_[x, z]
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        return cls(points, np.r_[0, np.cumsum(steps)], float(back))

    @property
    def middle(self) -> float:
        """The way to the middle."""
        return float(self.length[len(self.length) // 2])

    def at(self, way: float) -> tuple[Array, Array, Array]:
        """Point, tangent and outward normal, (2,) each, at a way along the arch."""
        way = float(np.clip(way, 0, self.length[-1] - 1e-6))
        ahead, behind = self._point(min(way + 0.02, float(self.length[-1]))), self._point(max(way - 0.02, 0))
        tangent = (ahead - behind) / math.hypot(*(ahead - behind))
        point = self._point(way)
        normal = np.array([-tangent[1], tangent[0]])
        return point, tangent, -normal if normal @ (point - [0, self.back]) < 0 else normal

    def _point(self, way: float) -> Array:
        return np.array([np.interp(way, self.length, self.points[:, axis]) for axis in (0, 1)])


def _power(value: Array, exponent: float) -> Array:
    """A power that keeps the sign."""
    powered: Array = np.sign(value) * np.abs(value) ** exponent
    return powered


def _jaw(arch: _Arch, widths: Array, heights: Array, edge: float, upper: bool, noise: np.random.Generator) -> Jaw:
    """Args: widths and heights (7,) dm from the middle out; `edge` the y of the biting edge."""
    down = 1 if upper else -1  # the gum is above an upper tooth's edge, below a lower one's
    centres = np.cumsum(widths) - widths / 2
    crowns = [
        _tooth(arch, arch.middle + side * centres[number], widths[number], heights[number], number, edge, down, noise)
        for side in (-1, 1)
        for number in range(len(widths))
    ]
    faces: Faces = []
    for number in range(len(crowns)):
        faces += _tube(ALONG, AROUND, number * (ALONG + 1) * AROUND)
    gum = _gum(arch, centres, widths, heights, edge, down)
    return Jaw(np.concatenate(crowns), faces, gum, _tube(GUM_STEPS, GUM_AROUND, 0))


def _tube(rings: int, around: int, first: int) -> Faces:
    """Faces between neighbouring rings of vertices, numbered from `first`."""
    return [
        (
            first + ring * around + at,
            first + ring * around + (at + 1) % around,
            first + (ring + 1) * around + (at + 1) % around,
            first + (ring + 1) * around + at,
        )
        for ring in range(rings)
        for at in range(around)
    ]


def _tooth(
    arch: _Arch,
    way: float,
    width: float,
    height: float,
    number: int,
    edge: float,
    down: int,
    noise: np.random.Generator,
) -> Array:
    """((ALONG + 1) * AROUND, 3) rings from the gum to the edge."""
    point, tangent, normal = arch.at(way)
    uneven = noise.normal(0, 1, 4)
    height *= 1 + 0.02 * uneven[0]
    angle = -math.pi / 2 + math.pi * np.arange(ALONG + 1)[:, None] / ALONG
    turn = 2 * math.pi * np.arange(AROUND)[None] / AROUND
    share = (_power(np.sin(angle), 0.38) + 1) / 2  # 0 at the gum, 1 at the edge
    ring = np.abs(np.cos(angle)) ** 0.25
    half_width = width * 0.5 * (0.82 + 0.18 * np.minimum(1, share * 1.5)) * 1.06
    half_depth = THICKNESSES[number] * 0.5 * (1 - (1 - EDGES[number]) * share**1.3)
    across, depth = _power(np.cos(turn), 0.62), _power(np.sin(turn), 0.62)
    bulge = 0.012 * (1 - (2 * share - 1) ** 2) * (depth > 0)
    lean = -0.03 * (1 - share)
    rise = np.broadcast_to(height * share, (ALONG + 1, AROUND))
    if number == CANINE:  # comes to a point
        rise = rise - np.where(share > 0.6, np.abs(across) * ring * 0.10 * height, 0)
    outwards = half_depth * ring * depth + bulge + lean - THICKNESSES[number] * 0.5 + 0.004 * uneven[1]
    flat = point + tangent * (half_width * ring * across)[..., None] + normal * outwards[..., None]
    y = edge + down * (height - rise) + 0.003 * uneven[2]
    return np.stack([flat[..., 0], y, flat[..., 1]], -1).reshape(-1, 3)


def _gum(arch: _Arch, centres: Array, widths: Array, heights: Array, edge: float, down: int) -> Array:
    """((GUM_STEPS + 1) * GUM_AROUND, 3): a tube along the arch, scalloped between the teeth."""
    outer = np.cumsum(widths)
    reach = centres[-1] + widths[-1] / 2
    angle = 2 * math.pi * np.arange(GUM_AROUND) / GUM_AROUND
    rings = []
    for step in range(GUM_STEPS + 1):
        way = arch.middle - reach + 2 * reach * step / GUM_STEPS
        point, _, normal = arch.at(way)
        away = abs(way - arch.middle)
        number = min(int(np.searchsorted(outer, away)), len(widths) - 1)
        phase = (away - (outer[number] - widths[number])) / widths[number]
        scallop = 0.35 * (2 * abs(phase - 0.5)) ** 2 * 0.10
        centre = edge + down * (heights[number] * 0.80 + 0.075)
        up = np.sin(angle) * (0.09 + np.where(np.sin(angle) * down < 0, scallop, 0))
        flat = point + normal * (np.cos(angle) * 0.052 - 0.045)[:, None]
        rings.append(np.stack([flat[:, 0], centre + up, flat[:, 1]], -1))
    return np.concatenate(rings)
