"""The background loop in memory, with its pose track and masks, and how a mouth is put onto it (Fu 2011, 3.2).

Every picture of the loop shows the mouth at rest, as the model itself draws it, so speech that begins or ends at rest
begins and ends on the very pixels of the loop. A speaking frame is

    out = loop - mask * rest + mask * mouth

where `rest` and `mouth` are the model's mouth at rest and now, both drawn at this frame's head pose, and `mask` is the
feathered mouth region at that pose. Skin that does not move keeps the loop's own pixels; the lips and the inside of
the mouth are the model's.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, cast, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.frame import Picture, planes
from app.engine.warp import blend, halve_map, pixel_grid, sample

Float = NDArray[np.float32]

STILL = -1
"""Loop frame that stands for the recording's own rest pose: no head motion, and no detail the recording lacks."""

GRID = 4
"""Pixels between the nodes of a stored pose map."""


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle of the picture in pixels; all four numbers are even."""

    x: int
    y: int
    width: int
    height: int

    def luma(self, picture: Picture) -> Picture:
        """The rectangle of the luma plane of a picture (a view)."""
        return planes(picture)[0][self.y : self.y + self.height, self.x : self.x + self.width]

    def chroma(self, picture: Picture) -> tuple[Picture, Picture]:
        """The rectangle of both chroma planes (views)."""
        _, blue, red = planes(picture)
        rows = slice(self.y // 2, (self.y + self.height) // 2)
        columns = slice(self.x // 2, (self.x + self.width) // 2)
        return blue[rows, columns], red[rows, columns]


@dataclass(frozen=True, slots=True)
class Planes:
    """Float planes of one region: luma (h, w), chroma (h / 2, w / 2)."""

    luma: Float
    blue: Float
    red: Float

    @classmethod
    def empty(cls, width: int, height: int) -> Planes:
        """Uninitialised planes of a region."""
        half = (height // 2, width // 2)
        return cls(np.empty((height, width), np.float32), np.empty(half, np.float32), np.empty(half, np.float32))

    def each(self) -> tuple[Float, Float, Float]:
        """The three planes, in order."""
        return self.luma, self.blue, self.red


@dataclass(frozen=True)
class Background:
    """A loop of pictures and where the mouth sits in each.

    Attributes:
        pictures: (L + 1, H * 3 // 2, W) uint8; the last one is the recording's rest pose (`STILL`).
        crop: where the mouth crops were cut from the recording's frame.
        region: the part of the picture that a mouth can touch at any pose.
        pose: (L + 1, rows, columns, 2) float32, displacement from each `GRID`th pixel of `region` at this frame to the
            same point of the face in the recording's frame (backward map), in pixels.
        mask: (crop.height, crop.width) in 0..1, feathered: how much of the mouth crop replaces the picture.
    """

    pictures: NDArray[np.uint8]
    crop: Box
    region: Box
    pose: Float
    mask: Float

    @property
    def frames(self) -> int:
        """Pictures in the loop."""
        return len(self.pictures) - 1

    def index(self, loop_frame: int) -> int:
        """Position in `pictures` of a loop frame, which counts on for ever, or of `STILL`."""
        return self.frames if loop_frame == STILL else loop_frame % self.frames

    def backward(self, index: int) -> Float:
        """(region.height, region.width, 2): the crop coordinates shown at each pixel of the region."""
        grid = pixel_grid(self.region.width, self.region.height)
        moved = sample(self.pose[index], grid / np.float32(GRID), smooth=False)
        where: Float = moved + grid + self._origin()
        return where

    def forward(self, index: int, points: Float) -> Float:
        """Where points of the crop, (..., 2), are shown, in coordinates of the region.

        A fixed point finds the inverse of the backward map wherever that changes by well under a pixel a pixel, as
        a face that turns does; training makes sure of it.
        """
        still = points - self._origin()
        flat = still.reshape(-1, 1, 2).astype(np.float32)
        shown = flat
        for _ in range(8):
            shown = flat - sample(self.pose[index], shown / np.float32(GRID), smooth=False)
        return cast(Float, shown.reshape(points.shape))

    def _origin(self) -> Float:
        """Crop coordinates of the region's first pixel."""
        return np.array([self.region.x - self.crop.x, self.region.y - self.crop.y], np.float32)

    def posed_mask(self, index: int) -> tuple[Float, Float]:
        """The mask at a frame's pose, for luma and, as the mean of 2x2, for chroma."""
        where = self.backward(index)
        luma = sample(self.mask, where, smooth=False, zero_outside=True)
        chroma = cv2.resize(luma, (luma.shape[1] // 2, luma.shape[0] // 2), interpolation=cv2.INTER_AREA)
        return luma, chroma.astype(np.float32)


class Mouth(Protocol):
    """Draws the mouth of some coefficients at a loop frame's pose."""

    def draw(self, coefficients: Float, index: int, out: Planes) -> None:
        """Fill `out`, of the background's region; only where the mask is above zero does it matter."""


@runtime_checkable
class Planner(Protocol):
    """A `Mouth` that looks at whole trajectories before it draws: one that shows samples of the recording, say."""

    def plan(self, rows: Float, before: Float | None) -> Float:
        """What it will draw for a trajectory, as coefficients again.

        Args:
            rows: (T, K) that a trajectory model gave.
            before: (b, K) of the frames in front, planned ones.

        Returns:
            (T, K), float32; `draw` knows each of these rows again.
        """


_BASE_SCALE = np.float32(64)
_MASK_SCALE = np.float32(255)


class Compositor:
    """Puts a mouth onto the loop. Safe to use from several threads."""

    def __init__(self, background: Background, mouth: Mouth, rest: Float) -> None:
        self._background = background
        self._mouth = mouth
        self._rest = rest
        self._local = _Scratch(background.region)
        count = len(background.pictures)
        box = background.region
        half = (count, box.height // 2, box.width // 2)
        self._base = (
            np.empty((count, box.height, box.width), np.int16),
            np.empty(half, np.int16),
            np.empty(half, np.int16),
        )
        self._masks = (np.empty((count, box.height, box.width), np.uint8), np.empty(half, np.uint8))
        self._prepare()

    def _prepare(self) -> None:
        rest = Planes.empty(self._background.region.width, self._background.region.height)
        box = self._background.region
        for index, picture in enumerate(self._background.pictures):
            self._mouth.draw(self._rest, index, rest)
            shown = (box.luma(picture), *box.chroma(picture))
            luma_mask, chroma_mask = self._background.posed_mask(index)
            for plane, mask in enumerate((luma_mask, chroma_mask)):
                self._masks[plane][index] = np.rint(mask * _MASK_SCALE)
            masks = (self._masks[0][index], self._masks[1][index], self._masks[1][index])
            for plane, (loop, mouth, mask8) in enumerate(zip(shown, rest.each(), masks, strict=True)):
                level = (loop - mask8 * (mouth / _MASK_SCALE)) * _BASE_SCALE
                self._base[plane][index] = np.clip(np.rint(level), -32768, 32767)

    def render(self, coefficients: Float | None, loop_frame: int, out: Picture) -> None:
        """Write a whole picture: the loop's frame, with the mouth of some coefficients unless they are None."""
        index = self._background.index(loop_frame)
        np.copyto(out, self._background.pictures[index])
        if coefficients is None:
            return
        mouth = self._local.planes
        self._mouth.draw(coefficients, index, mouth)
        targets = (self._background.region.luma(out), *self._background.region.chroma(out))
        masks = (self._masks[0][index], self._masks[1][index], self._masks[1][index])
        for plane, (target, drawn) in enumerate(zip(targets, mouth.each(), strict=True)):
            blend(self._base[plane][index], masks[plane], drawn, target)


class _Scratch:
    """Buffers of one thread each."""

    def __init__(self, box: Box) -> None:
        self._box = box
        self._local = threading.local()

    @property
    def planes(self) -> Planes:
        found: Planes | None = getattr(self._local, "planes", None)
        if found is None:
            found = self._local.planes = Planes.empty(self._box.width, self._box.height)
        return found


@dataclass(frozen=True)
class Placement:
    """The pose maps of all loop frames for one mesh of texture vertices.

    Attributes:
        background: whose frames.
        step: texture pixels between mesh vertices.
    """

    background: Background
    step: int

    @cached_property
    def vertices(self) -> Float:
        """(rows, columns, 2), where the mesh vertices are in the crop before any flow."""
        crop = self.background.crop
        return np.ascontiguousarray(pixel_grid(crop.width, crop.height)[:: self.step, :: self.step])

    @cached_property
    def shift(self) -> Float:
        """(L + 1, rows, columns, 2): what the pose adds to a crop point to give its place in the region."""
        points = self.vertices
        return np.stack([self.background.forward(i, points) - points for i in range(len(self.background.pictures))])


def chroma_map(luma_map: Float) -> Float:
    """Texture coordinates of chroma from those of luma, (h, w, 2) to (h / 2, w / 2, 2)."""
    out = np.empty((luma_map.shape[0] // 2, luma_map.shape[1] // 2, 2), np.float32)
    halve_map(luma_map, out)
    return out
