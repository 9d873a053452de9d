"""The first look at a take: the pose of every picture, its mouth at rest, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from app.engine.background import Box
from app.engine.frame import Picture, planes
from app.engine.pack import FPS
from app.engine.training.face_tracker import FaceTemplate, align, locate, tracked, tracking_scale
from app.engine.training.footage import shots
from app.engine.training.layout import Layout, only_face
from app.engine.training.take import Refusal, Take, passages, resting
from app.errors import TrainingFailed

Float = NDArray[np.float32]
Array = NDArray[np.float64]

SMOOTHED = 1.0
"""Frames: standard deviation of the poses' smoothing in time."""
FASTEST = 0.07
"""Sides of the face box that a face may move from one picture to the next; faster is blurred."""
GREY = 0.35
"""Of the template's contrast: eyes and nose of less are a grey picture."""
LOST = 3.0
"""Times the usual residual of a take: more, and the face is not where the tracker thinks, or something hides it."""
LEAST_RESIDUAL = 6.0
"""Luma levels: a residual below this is never taken for a lost face."""
MOST_BROKEN = 0.5
"""Share of a take's pictures that may be broken before nothing is learnt from it."""
THUMB = 24
"""Pixels a side."""
LOOK_AGAIN = 12
"""Pictures after which a lost face is looked for again."""


@dataclass(frozen=True)
class Survey:
    """What was seen of one take.

    Attributes:
        poses: (T, 2, 3) affine from reference coordinates to each picture, smoothed in time.
        residual: (T,) of the tracker, luma levels.
        good: (T,) what may be learnt from.
        refused: why the others may not.
        rest: (S, P) mean crop at rest in every passage, uint8 planes flattened; of no meaning where `rested` is zero.
        rested: (S,) how many pictures it is the mean of.
        thumbs: (T, THUMB, THUMB) uint8 luma of whole pictures, tiny: which pictures could follow each other.
    """

    poses: Array
    residual: Float
    good: NDArray[np.bool_]
    refused: tuple[Refusal, ...]
    rest: NDArray[np.uint8]
    rested: NDArray[np.int64]
    thumbs: NDArray[np.uint8]

    @property
    def frames(self) -> int:
        """T."""
        return len(self.poses)


def survey(take: Take, layout: Layout) -> Survey:
    """Look through one take.

    Raises:
        TrainingFailed: it cannot be decoded, shows no face or several, or most of its pictures are broken.
    """
    template = layout.template
    raw: list[Array | None] = []
    residual: list[float] = []
    problems: list[str] = []
    sums: dict[int, Array] = {}  # by passage; the crops themselves would fill the memory on a long take
    counts: dict[int, int] = {}
    still = resting(take.phones, round(take.phones[-1].end * FPS) + 50)
    ends = np.array([span.stop for span in passages(take.phones, len(still))])
    thumbs: list[NDArray[np.uint8]] = []
    face = Follower(template, take.name)
    before = np.empty(0, np.uint8)
    for number, shot in enumerate(shots(take.video)):
        luma = planes(shot.picture)[0]
        found = face.follow(luma)
        problem = "" if shot.fresh else "the picture before it was shown again"
        if found is None:
            problem = problem or face.problem
        elif not problem and np.array_equal(luma, before) and not still[min(number, len(still) - 1)]:
            problem = "identical with the picture before"
        before = luma.copy()
        thumbs.append(cv2.resize(luma, (THUMB, THUMB), interpolation=cv2.INTER_AREA).astype(np.uint8))
        raw.append(found.pose if found else None)
        residual.append(found.residual if found else np.nan)
        problems.append(problem)
        if found is not None and not problem and number < len(still) and still[number]:
            passage = int(np.searchsorted(ends, number, side="right"))
            flat = cut(shot.picture, found.pose, layout.crop)
            sums[passage] = sums.get(passage, np.zeros(len(flat))) + flat
            counts[passage] = counts.get(passage, 0) + 1
    if not any(pose is not None for pose in raw):
        raise TrainingFailed(f"{take.name}: {face.problem or 'no face found'}")
    cuts, jumps = _jumps(raw, template.box.side)
    poses = smoothed(raw, cuts)
    numbers = np.array(residual, np.float32)
    problems = _judged(problems, numbers, jumps)
    good = np.array([not problem for problem in problems])
    if good.mean() < 1 - MOST_BROKEN:
        common = max(set(filter(None, problems)), key=problems.count)
        raise TrainingFailed(f"{take.name}: {(~good).sum()} of {len(good)} pictures are broken, most: {common}")
    refused = tuple(Refusal(take.name, number, problem) for number, problem in enumerate(problems) if problem)
    spans = passages(take.phones, len(poses))
    rest = np.zeros((len(spans), layout.crop.width * layout.crop.height * 3 // 2), np.uint8)
    rested = np.zeros(len(spans), np.int64)
    for index in range(len(spans)):
        rested[index] = counts.get(index, 0)
        if rested[index]:
            rest[index] = np.rint(sums[index] / rested[index])
    return Survey(poses, numbers, good, refused, rest, rested, np.stack(thumbs))


class Follower:
    """Follows the one face of a take from picture to picture, and finds it again when it was lost."""

    def __init__(self, template: FaceTemplate, name: str) -> None:
        self._template, self._name = template, name
        self._pose: Array | None = None
        self._scale = template.scale
        self._since = LOOK_AGAIN
        self._usual: list[float] = []
        self.problem = ""

    def follow(self, luma: NDArray[np.uint8]) -> Pose | None:
        """The face's pose in the next picture (H, W); None, with `problem` set, if it is not seen."""
        self.problem = ""
        if self._pose is None:
            self._since += 1
            if self._since < LOOK_AGAIN and self._usual:
                self.problem = "no face found"
                return None
            self._since = 0
            try:
                box = only_face(luma, self._name)
            except TrainingFailed as error:
                self.problem = error.message.partition(": ")[2]
                return None
            self._scale = tracking_scale(box)
            small = tracked(luma, self._scale)
            self._pose = locate(self._template, small, self._scale, box).pose
        small = tracked(luma, self._scale)
        contrast = self._contrast(small)
        if contrast < GREY:
            self.problem = "grey: eyes and nose have hardly any contrast"
            return None
        found = align(self._template, small, self._scale, self._pose)
        if not self._plausible(found.pose, luma.shape):
            self._pose, self.problem = None, "the face was lost"
            return None
        usual = float(np.median(self._usual)) if self._usual else found.residual
        if len(self._usual) >= 10 and found.residual > max(LOST * usual, LEAST_RESIDUAL):
            self._pose, self.problem = None, "the face was lost"
            return None
        self._usual = [*self._usual[-200:], found.residual]
        self._pose = found.pose
        return Pose(found.pose, found.residual)

    def _contrast(self, small: Float) -> float:
        assert self._pose is not None
        left, top, right, bottom = self._template.bounds
        corners = np.array([[left, right, left, right], [top, top, bottom, bottom], [1, 1, 1, 1]])
        x, y = self._template.tracked_warp(self._pose, self._scale)[:2] @ corners
        window = small[max(0, int(y.min())) : int(y.max()), max(0, int(x.min())) : int(x.max())]
        return float(window.std()) / float(self._template.target.std()) if window.size else 0.0

    def _plausible(self, pose: Array, shape: tuple[int, ...]) -> bool:
        box = self._template.box
        x, y = pose @ np.array([box.x + box.side / 2, box.y + box.side / 2, 1])
        size = float(np.hypot(*pose[:, 0])) * box.side
        return bool(0 <= x < shape[1] and 0 <= y < shape[0] and 0.1 * min(shape) < size < 1.5 * max(shape))


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the face of one picture is; see `app.engine.training.face_tracker.Aligned`."""

    pose: Array
    residual: float


def smoothed(raw: Sequence[Array | None], cuts: Sequence[int] = ()) -> Array:
    """(T, 2, 3) poses, interpolated where there is none and smoothed by `SMOOTHED` frames, but not across `cuts`."""
    known = np.array([number for number, pose in enumerate(raw) if pose is not None])
    values = np.stack([pose for pose in raw if pose is not None]).reshape(-1, 6)
    every = np.arange(len(raw))
    filled = np.stack([np.interp(every, known, values[:, column]) for column in range(6)], 1)
    steady = [gaussian_filter1d(part, SMOOTHED, axis=0, mode="nearest") for part in np.split(filled, cuts)]
    return np.concatenate(steady).reshape(-1, 2, 3)


def _jumps(raw: Sequence[Array | None], side: float) -> tuple[list[int], dict[int, float]]:
    """Where no motion can be told from one picture to the next, and pictures to which the head moved too fast.

    Returns:
        numbers of pictures that begin anew, and pixels a picture for those of them whose head was seen before, too.
    """
    cuts: set[int] = set()
    jumps: dict[int, float] = {}
    last: tuple[int, Array] | None = None
    for number, pose in enumerate(raw):
        if pose is None:
            continue
        if last is not None:
            change = pose - last[1]
            moved = float(np.linalg.norm(change[:, :2].sum(1) * side / 2 + change[:, 2]))
            if moved > FASTEST * side * float(np.hypot(*pose[:, 0])):
                cuts |= {last[0] + 1, number}
                if number == last[0] + 1:
                    jumps[number] = moved
        last = number, pose
    return sorted(cuts), jumps


def _judged(problems: list[str], residual: Float, jumps: Mapping[int, float]) -> list[str]:
    """Problems, those added that only show beside the other pictures."""
    usual = float(np.nanmedian(residual))
    judged = list(problems)
    for number, problem in enumerate(problems):
        if problem:
            continue
        if number in jumps:
            judged[number] = f"the head moves too fast: {jumps[number]:.0f} pixels in one picture"
        elif residual[number] > max(LOST * usual, LEAST_RESIDUAL):
            judged[number] = f"eyes and nose do not look like those of the others (difference {residual[number]:.0f})"
    return judged


def cut(picture: Picture, pose: Array, crop: Box, *, shift: Array | None = None) -> NDArray[np.uint8]:
    """The stabilised crop of a picture, (P,) planes flattened: one cubic interpolation.

    Args:
        picture: whose.
        pose: (2, 3) from reference coordinates to it.
        crop: in the reference picture.
        shift: (2, 3) affine from crop to crop coordinates, applied first: the passage's own correction.
    """
    to_reference = np.array([[1, 0, crop.x], [0, 1, crop.y], [0, 0, 1.0]])
    own = np.eye(3) if shift is None else np.vstack([shift, [0, 0, 1]])
    luma_map = pose @ to_reference @ own
    # chroma (i, j) lies at luma (2 i, 2 j + 1/2), on both sides
    up = np.array([[2, 0, 0], [0, 2, 0.5], [0, 0, 1.0]])
    chroma_map = (np.linalg.inv(up) @ np.vstack([luma_map, [0, 0, 1]]) @ up)[:2]
    flat = []
    for plane, warp, size in zip(
        planes(picture), (luma_map, chroma_map, chroma_map),
        ((crop.width, crop.height), *[(crop.width // 2, crop.height // 2)] * 2), strict=True,
    ):  # fmt: skip
        source = plane
        zoom = float(np.hypot(warp[0, 0], warp[1, 0]))
        if zoom > 1.5:  # a much larger face than the reference's: cubic interpolation would alias
            source = cv2.GaussianBlur(plane, (0, 0), 0.4 * zoom)  # type: ignore[assignment]
        flat.append(
            cv2.warpAffine(
                source, warp, size, flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
            ).ravel()
        )
    return np.concatenate(flat)
