"""The geometry of a recording: its reference picture, the face in it, and the crop that the mouth is cut by."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.background import Box
from app.engine.frame import Picture, planes
from app.engine.pack import FPS
from app.engine.training.face_detector import FaceBox, find_faces
from app.engine.training.face_tracker import (
    FaceTemplate,
    align,
    locate,
    template_of,
    tracked,
    tracking_scale,
)
from app.engine.training.footage import Shot, shots
from app.engine.training.take import Refusal, Take
from app.errors import TrainingFailed

Float = NDArray[np.float32]
Array = NDArray[np.float64]

SAMPLED_TAKES, SAMPLED_SECONDS = 24, 72.0
"""How many takes are looked at, and how much of them together, to find out where the mouth is."""
MOST_MOVED = 0.1
"""Sides of the face box from one picture to the next; beyond it, the picture was cut."""
AVERAGED = 15
"""Every so manyth of these pictures goes into the template."""
MOUTH, MOUTH_SPREAD = (0.515, 0.813), 0.06
"""Where the mouth usually is in the face box, and how far off, in its sides; the motion found there corrects it."""
CROP = (0.72, 0.62)
"""Width and height of the crop, in sides of the face box: mouth, chin and the cheeks that move with them."""
ELLIPSE, FEATHER = (0.24, 0.25), 0.2
"""Radii of the mouth mask in sides of the face box, and the share of them over which it falls from one to zero."""
MOUTH_BOX = (0.365, 0.30)
"""Width and height of the box that figures are measured in, in sides of the face box."""


@dataclass(frozen=True)
class Layout:
    """Where things are in the reference picture, whose coordinates all poses refer to.

    Attributes:
        reference: the reference picture (H * 3 // 2, W).
        template: what the tracker looks for.
        crop: the mouth region.
        side: of the face box in the reference picture, as it usually is: the unit of everything laid out.
    """

    reference: Picture
    template: FaceTemplate
    crop: Box
    side: float

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the reference picture."""
        return self.reference.shape[1], self.reference.shape[0] * 2 // 3


def face_mask(crop: Box, side: float) -> Float:
    """(h, w) the mouth mask of a crop: an ellipse of mouth, chin and lower cheeks, 1 inside and 0 outside.

    A wider mask would have the model spend itself on hair, collar and what the head pose leaves over.

    Args:
        crop: only its size matters.
        side: of the face box, pixels.
    """
    y, x = np.mgrid[: crop.height, : crop.width].astype(np.float32)
    x, y = x - (crop.width - 1) / 2, y - (crop.height - 1) / 2
    radius = np.hypot(x / (ELLIPSE[0] * side), y / (ELLIPSE[1] * side))
    share = np.clip((1 - radius) / FEATHER + 1, 0, 1)
    mask: Float = (share * share * (3 - 2 * share)).astype(np.float32)
    return mask


def importance(crop: Box, side: float) -> Float:
    """(h, w) how much an error of each pixel counts in learning: the mask, and four times as much on lips and teeth.

    Args:
        crop, side: see `face_mask`.
    """
    mouth = np.zeros((crop.height, crop.width), np.float32)
    mouth[mouth_box(crop, side)] = 1
    soft = cv2.GaussianBlur(mouth, (0, 0), 0.04 * side)
    weighted: Float = (face_mask(crop, side) * (0.25 + 0.75 * soft)).astype(np.float32)
    return weighted


def mouth_box(crop: Box, side: float) -> tuple[slice, slice]:
    """Rows and columns of a crop that figures of picture quality are measured in: lips, teeth, and around them."""
    half_width, half_height = (round(share * side / 2) for share in MOUTH_BOX)
    x, y = crop.width // 2, crop.height // 2
    return slice(y - half_height, y + half_height), slice(x - half_width, x + half_width)


def only_face(luma: NDArray[np.uint8], where: str) -> FaceBox:
    """The one face of a picture (H, W).

    Raises:
        TrainingFailed: none, or more than one.
    """
    found = find_faces(luma)
    if not found:
        raise TrainingFailed(f"{where}: no face found", advice="The face must be seen from the front, upright.")
    if len(found) > 1:
        raise TrainingFailed(f"{where}: {len(found)} faces", advice="Film one person, or crop the others away.")
    return found[0]


def lay_out(takes: Sequence[Take]) -> tuple[Layout, list[Refusal]]:
    """Find the reference picture, the template and the mouth of a recording.

    Args:
        takes: in order; the first that shows one face gives the reference picture.

    Returns:
        the layout, and the takes in which no face (or more than one) was found on the way.

    Raises:
        TrainingFailed: no take shows one face.
    """
    refused: list[Refusal] = []
    chosen = [takes[round(at)] for at in np.linspace(0, len(takes) - 1, min(SAMPLED_TAKES, len(takes)))]
    count = round(SAMPLED_SECONDS * FPS / len(chosen))
    layout: Layout | None = None
    averages: list[Float] = []
    sides: list[float] = []
    motion: Array | None = None
    for take in chosen:
        pictures = islice(shots(take.video), count)
        try:
            picture, box = _beginning(pictures, take.name)
            if layout is None:
                layout = Layout(picture, template_of(planes(picture)[0], box), Box(0, 0, 2, 2), box.side)
            spread = _Spread()
            for number, (pose, shown) in enumerate(_followed(layout.template, picture, box, pictures)):
                if number == 0:
                    sides.append(box.side / float(np.hypot(*pose[:, 0])))
                if number % AVERAGED == 0:
                    averages.append(shown)
                spread.add(shown)
        except TrainingFailed as error:
            refused.append(Refusal(take.name, None, error.message))
            continue
        motion = spread.variance() if motion is None else motion + spread.variance()
    if layout is None or motion is None:
        first = refused[0]
        raise TrainingFailed(
            first.reason, advice="Every clip needs one face, seen from the front, a seventh of the picture or larger."
        )
    reference = layout.template
    side = float(np.median(sides))
    template = FaceTemplate(np.mean(averages, 0).astype(np.float32), reference.box, reference.scale)
    x, y = _mouth(motion.astype(np.float32), reference)
    return Layout(layout.reference, template, _crop(x, y, side, layout.size), side), refused


def _beginning(pictures: Iterator[Shot], name: str) -> tuple[Picture, FaceBox]:
    """The first of some pictures, half a second apart, that shows one face, and where; raises as `only_face`."""
    problem: TrainingFailed | None = None
    for shot in islice(pictures, 0, None, FPS // 2):
        try:
            return shot.picture.copy(), only_face(planes(shot.picture)[0], name)
        except TrainingFailed as error:
            problem = problem or error
    raise problem or TrainingFailed(f"{name}: no picture")


def _followed(
    template: FaceTemplate, picture: Picture, box: FaceBox, others: Iterator[Shot]
) -> Iterator[tuple[Array, Float]]:
    """Pose and stabilised picture, at tracking scale, of a picture with a known face and of those after it."""
    scale = tracking_scale(box)
    small = tracked(planes(picture)[0], scale)
    pose = locate(template, small, scale, box).pose
    yield pose, _stabilised(small, pose, scale, template)
    for shot in others:
        luma = planes(shot.picture)[0]
        small = tracked(luma, scale)
        found = align(template, small, scale, pose)
        if not _near(found.pose, pose, template):  # a cut, or the face is gone: look for it again
            faces = find_faces(luma)
            if len(faces) != 1:
                continue
            found = locate(template, small, scale, faces[0])
            if not (np.isfinite(found.pose).all() and np.isfinite(found.residual)):
                continue
        pose = found.pose
        yield pose, _stabilised(small, pose, scale, template)


def _near(pose: Array, before: Array, template: FaceTemplate) -> bool:
    """Whether a face can have moved so from one picture to the next; never if the pose is no number."""
    box = template.box
    centre = np.array([box.x + box.side / 2, box.y + box.side / 2, 1])
    scale, scale_before = (float(np.hypot(*each[:, 0])) for each in (pose, before))
    moved = float(np.linalg.norm((pose - before) @ centre))
    return moved < MOST_MOVED * box.side * scale_before and 0.9 < scale / scale_before < 1.1


class _Spread:
    """How much each pixel of some pictures differs, without keeping them."""

    def __init__(self) -> None:
        self._count, self._sum, self._squares = 0, np.zeros(()), np.zeros(())

    def add(self, picture: Float) -> None:
        exact = picture.astype(np.float64)
        self._count, self._sum, self._squares = self._count + 1, self._sum + exact, self._squares + exact * exact

    def variance(self) -> Array:
        spread: Array = np.maximum(self._squares / self._count - (self._sum / self._count) ** 2, 0)
        return spread


def _stabilised(small: Float, pose: Array, scale: float, template: FaceTemplate) -> Float:
    """A tracked picture in the template's coordinates."""
    warp = template.tracked_warp(pose, scale)[:2]
    height, width = template.luma.shape
    return cv2.warpAffine(  # type: ignore[return-value]
        small, warp, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    )


def _mouth(motion: Float, template: FaceTemplate) -> tuple[float, float]:
    """The middle of what moves about where a mouth should be, in reference pixels."""
    box, scale = template.box, template.scale
    y, x = np.mgrid[: motion.shape[0], : motion.shape[1]]
    off_x = (x - (box.x + MOUTH[0] * box.side) * scale) / (MOUTH_SPREAD * box.side * scale)
    off_y = (y - (box.y + MOUTH[1] * box.side) * scale) / (MOUTH_SPREAD * box.side * scale)
    weight = np.maximum(motion, 1e-6) * np.exp(-0.5 * (off_x**2 + off_y**2))
    middle = np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()
    x_mean, y_mean = ((middle + 0.5) / scale - 0.5).tolist()
    return x_mean, y_mean


def _crop(x: float, y: float, side: float, size: tuple[int, int]) -> Box:
    """The crop around a mouth, within the picture, all numbers even."""
    width, height = (2 * round(share * side / 2) for share in CROP)
    width, height = min(width, size[0]), min(height, size[1])
    left = min(max(0, 2 * round((x - width / 2) / 2)), size[0] - width)
    top = min(max(0, 2 * round((y - height / 2) / 2)), size[1] - height)
    return Box(left, top, width, height)
