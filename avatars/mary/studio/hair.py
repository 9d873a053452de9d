"""A bob that ends at the chin: strands that grow from the parting down an ellipsoid, and a dark cap under them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.face import Face
from avatars.mary.studio.smoothstep import smoothstep

Array = NDArray[np.float64]
Faces = list[tuple[int, ...]]

SKULL_RADII = np.array([0.76, 1.05, 0.95])  # dm
STEPS, STEP = 34, 0.085  # of a growing strand; dm
POINTS = 16  # of a strand, in the end
CLUMPS = 1100
ROWS_AT_ONCE = 4000  # of distances to clumps; bounds the memory


def skull(face: Face) -> Array:
    """(3,) centre of the ellipsoid that the hair lies on, dm."""
    return np.array([0, face.eyes + 0.15, 0.45])


def bob(face: Face) -> Array:
    """(n, POINTS, 3) points of every strand from root to end, dm."""
    roots = _roots(face, np.random.default_rng(11), 0.05)
    lift = np.random.default_rng(5).uniform(0, 1, len(roots)) ** 1.3
    strands, side = _grown(face, roots, lift, np.random.default_rng(3))
    return _clumped(strands, roots, side, lift, face.look.clumping)


def _roots(face: Face, noise: np.random.Generator, softness: float) -> Array:
    """Points over the hairline, evenly over the skull, and more of them along the parting."""
    wanted, parting = face.look.hair_strands, face.look.parting
    directions = noise.normal(size=(wanted * 9, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    points = skull(face) + directions * SKULL_RADII * 0.985
    area = np.linalg.norm(directions / SKULL_RADII, axis=1)
    points = points[noise.random(len(points)) < area / area.max()]
    over = (points[:, 1] - face.eyes) - np.maximum(face.hairline(face.azimuth(points)), -0.45)
    ragged = np.abs(noise.normal(0, softness, len(points))) * (noise.random(len(points)) < 0.7)
    points = points[over > ragged]
    at_parting = (np.abs(points[:, 0] - parting) < 0.10) & (points[:, 2] > 0.4)
    return np.concatenate([points[:wanted], points[wanted:][at_parting[wanted:]]])


def _grown(face: Face, roots: Array, lift: Array, noise: np.random.Generator) -> tuple[Array, Array]:
    """Strands (n, POINTS, 3) from their roots to the bob's end, and the side (n,) they fall to (1: her left).

    In the upper half of the skull they follow the ellipsoid, below they hang on a cylinder of the same outline.
    """
    count, centre, parting = len(roots), skull(face), face.look.parting
    parting_here = parting * (1 - 0.25 * (roots[:, 2] < 0.3)) + noise.normal(0, 0.035, count)
    side = np.where(roots[:, 0] > parting_here, 1.0, -1.0)
    near_parting = np.exp(-((np.abs(roots[:, 0] - parting) / 0.16) ** 2)) * (roots[:, 2] > 0.5)
    forward_steps = noise.uniform(0, 5, count)
    wave, phase = noise.normal(0, 0.10, count), noise.uniform(0, 6.28, count)
    at = roots.copy()
    path = [roots - (roots - centre) * 0.01]
    for step in range(STEPS):
        outward = (at - centre) / SKULL_RADII
        outward[:, 1] = np.maximum(outward[:, 1], 0)
        outward /= SKULL_RADII
        outward /= np.linalg.norm(outward, axis=1)[:, None]
        azimuth = np.degrees(np.abs(np.arctan2(at[:, 0], at[:, 2] - 0.45)))
        front = smoothstep(80, 52, azimuth) * smoothstep(0.05, 0.35, at[:, 1] - face.eyes)
        forward = near_parting * (step < forward_steps) * (at[:, 1] - face.eyes > 0.74)
        back = -0.55 + 0.75 * math.exp(-step / 5.0) * (at[:, 2] > 0.6) + 1.5 * forward
        sideways = np.stack([side * (1 - 0.75 * forward), np.zeros(count), back], 1)
        way = sideways * (front * 1.15 + 0.35 * smoothstep(0.6, 1.0, at[:, 1] - centre[1]))[:, None]
        way = way + np.array([0, -1.0, 0]) * (1 - 0.80 * front)[:, None]
        way += np.array([1, 0, 0]) * (wave * np.sin(step * 0.35 + phase))[:, None]
        way -= outward * (way * outward).sum(1, keepdims=True)
        way /= np.linalg.norm(way, axis=1)[:, None] + 1e-9
        at = _on_shell(at + way * STEP, centre, lift, min(1, (step + 1) / 5.0))
        path.append(at.copy())
    grown = np.stack(path, 1)
    end = face.eyes + face.look.hair_end + noise.normal(0, 0.035, count)
    end = end + 0.03 * np.sin(roots[:, 0] * 9) - 0.10 * (roots[:, 2] < 0.0)
    below = grown[:, :, 1] < end[:, None]
    last = np.where(below.any(1), below.argmax(1), STEPS).astype(float)
    place = np.linspace(0, 1, POINTS)[None] * last[:, None]
    before = np.minimum(place.astype(int), STEPS - 1)
    share = (place - before)[..., None]
    strand = np.arange(count)[:, None]
    return grown[strand, before] * (1 - share) + grown[strand, before + 1] * share, side


def _on_shell(points: Array, centre: Array, lift: Array, ramp: float) -> Array:
    """Points (n, 3) moved to the hair's surface, each as far out as its lift (n,), 0..1, says."""
    unit = (points - centre) / SKULL_RADII
    height = points[:, 1] - centre[1]
    radius = 1 + (0.03 + lift * (0.07 + 0.03 * smoothstep(0.3, -0.2, height))) * ramp
    radius = radius + 0.085 * smoothstep(0.45, -0.15, height) * ramp - 0.10 * smoothstep(-0.55, -1.25, height)
    on_skull = centre + unit / np.linalg.norm(unit, axis=1)[:, None] * SKULL_RADII * radius[:, None]
    around = np.linalg.norm(unit[:, [0, 2]], axis=1) + 1e-9
    hanging = points.copy()
    for axis in (0, 2):
        hanging[:, axis] = centre[axis] + unit[:, axis] / around * SKULL_RADII[axis] * radius
    return np.where((unit[:, 1] > 0)[:, None], on_skull, hanging)


def _clumped(strands: Array, roots: Array, side: Array, lift: Array, strength: float) -> Array:
    """Strands drawn towards those of the clump they belong to, more so to their ends, and ruffled a little."""
    count, points = strands.shape[:2]
    along = np.linspace(0, 1, points)
    leaders = np.random.default_rng(6).choice(count, CLUMPS, replace=False)
    nearest = np.empty(count, int)
    for first in range(0, count, ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        distance = ((roots[rows, None] - roots[leaders][None]) ** 2).sum(2)
        distance += 9 * (side[rows, None] != side[leaders][None])  # never across the parting
        distance += 0.02 * (lift[rows, None] - lift[leaders][None]) ** 2
        nearest[rows] = distance.argmin(1)
    share = np.random.default_rng(8).uniform(0.25, 0.8, (count, 1, 1)) * strength
    share = share * smoothstep(0.05, 1.0, along)[None, :, None]
    offset = np.random.default_rng(9).normal(0, 0.012, (count, 1, 3)) * along[None, :, None]
    ruffle = np.cumsum(np.random.default_rng(10).normal(0, 0.0012, strands.shape), 1)
    clumped: Array = strands * (1 - share) + strands[leaders][nearest] * share + offset + ruffle
    return clumped


def cap(face: Face) -> tuple[Array, Faces]:
    """Vertices (n, 3), dm, and faces of the dark cap on the skull, from the hairline up."""
    around, up, centre = 90, 24, skull(face)
    azimuth = -180 + 360 * np.arange(around + 1) / around
    start = face.eyes + np.maximum(face.hairline(np.abs(azimuth)), -0.30) + 0.035
    lowest = np.arcsin(np.clip((start - centre[1]) / SKULL_RADII[1], -0.45, 0.99))[:, None]
    height = lowest + (math.pi / 2 - lowest) * np.arange(up + 1) / up
    turn = np.radians(azimuth)[:, None]
    unit = np.stack([np.cos(height) * np.sin(turn), np.sin(height), np.cos(height) * np.cos(turn)], -1)
    return (centre + SKULL_RADII * unit * 1.006).reshape(-1, 3), _grid(around, up)


def curtain(face: Face) -> tuple[Array, Faces]:
    """Vertices (n, 3), dm, and faces of the dark sheet inside the hair that hangs down."""
    around, down, centre, open_degrees = 60, 14, skull(face), 84
    turn = np.radians(open_degrees + (360 - 2 * open_degrees) * np.arange(around + 1) / around)[:, None]
    top, bottom = centre[1] + 0.25, face.eyes + face.look.hair_end + 0.16
    y = (top + (bottom - top) * np.arange(down + 1) / down)[None]
    height = y - centre[1]
    radius = 1.045 - 0.05 * smoothstep(-0.55, -1.25, height)
    radius = radius * np.sqrt(np.maximum(0, 1 - np.maximum(0, height / SKULL_RADII[1]) ** 2))
    x = SKULL_RADII[0] * radius * np.sin(turn)
    z = centre[2] + SKULL_RADII[2] * radius * np.cos(turn)
    return np.stack([x, np.broadcast_to(y, x.shape), z], -1).reshape(-1, 3), _grid(around, down)


def _grid(columns: int, rows: int) -> Faces:
    """Faces of a grid of (columns + 1) by (rows + 1) vertices, numbered column by column."""
    size = rows + 1
    return [
        (column * size + row, (column + 1) * size + row, (column + 1) * size + row + 1, column * size + row + 1)
        for column in range(columns)
        for row in range(rows)
    ]
