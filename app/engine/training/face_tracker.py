"""Where the head is in every picture: a similarity from the reference picture, found on eyes and nose.

Inverse-compositional alignment (Baker and Matthews 2004) of a template with four degrees of freedom. Scale changes by
several per cent when people talk, so translation is not enough; an affine map is ill-conditioned and would wander at
the mouth, which the template leaves out. Robust weights make blinks and moving brows count for little.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.training.face_detector import FaceBox

Float = NDArray[np.float32]
Array = NDArray[np.float64]

TRACKED_SIDE = 150.0
"""Pixels: larger faces are made this large before they are tracked."""
REGION = (0.14, 0.20, 0.86, 0.70)
"""Left, top, right and bottom of what is tracked, in sides of the face box: brows, eyes and nose."""
NOSE = (0.25, 0.47)
"""Of the face box's side: under the second the region is narrower by the first at both sides; cheeks move in speech."""
BLUR = 1.0
"""Pixels of the tracked picture."""
ROUNDS, CONVERGED = 50, 2e-3
"""Most steps, and the change of the pose (pixels) that ends them: 5 usually, 40 after the fastest move that counts."""
UNIT = 40.0
"""Pixels in which turning and scaling are measured, so that all four numbers have one size."""
OUTLIER = (2.0, 6.0)
"""Residuals beyond the first many deviations count less, beyond the second nothing."""


@dataclass(frozen=True, slots=True)
class Aligned:
    """A picture's pose.

    Attributes:
        pose: (2, 3) affine from reference coordinates to the picture's, pixels.
        residual: root of the weighted mean squared difference to the template, luma levels at the template's contrast.
    """

    pose: Array
    residual: float


@dataclass(frozen=True)
class FaceTemplate:
    """What is looked for: smoothed luma of eyes and nose in reference coordinates.

    Attributes:
        luma: (h, w) the reference picture, or a mean of several, at tracking scale and smoothed.
        box: the face in the reference picture, in its own pixels.
        scale: tracked pixels a reference pixel.
    """

    luma: Float
    box: FaceBox
    scale: float

    @cached_property
    def bounds(self) -> tuple[int, int, int, int]:
        """Left, top, right, bottom of the region in `luma`."""
        height, width = self.luma.shape
        left, top, right, bottom = (
            round((start + share * self.box.side) * self.scale)
            for start, share in zip((self.box.x, self.box.y) * 2, REGION, strict=True)
        )
        return max(1, left), max(1, top), min(width - 1, right), min(height - 1, bottom)

    def tracked_warp(self, pose: Array, scale: float) -> Array:
        """(3, 3) affine from `luma` to a tracked picture of this scale, for a pose."""
        full = np.vstack([pose, [0, 0, 1]])
        warp: Array = _resized(scale) @ full @ np.linalg.inv(_resized(self.scale))
        return warp

    def pose_of(self, warp: Array, scale: float) -> Array:
        """(2, 3) pose for an affine (3, 3) from `luma` to a tracked picture of this scale."""
        pose: Array = (np.linalg.inv(_resized(scale)) @ warp @ _resized(self.scale))[:2]
        return pose

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """(n,) which pixels of the region count, flattened."""
        left, top, right, bottom = self.bounds
        used = np.ones((bottom - top, right - left), bool)
        below = round((self.box.y + NOSE[1] * self.box.side) * self.scale) - top
        margin = round((NOSE[0] - REGION[0]) * self.box.side * self.scale)
        used[max(below, 0) :, :margin] = False
        used[max(below, 0) :, used.shape[1] - margin :] = False
        return used.ravel()

    @cached_property
    def centre(self) -> Array:
        """(2,) middle of the region, in `luma`."""
        left, top, right, bottom = self.bounds
        return np.array([(left + right - 1) / 2, (top + bottom - 1) / 2])

    @cached_property
    def target(self) -> Float:
        """(m,) the region's luma where it counts."""
        left, top, right, bottom = self.bounds
        return self.luma[top:bottom, left:right].ravel()[self.inside]

    @cached_property
    def slopes(self) -> Float:
        """(m, 4) what the region changes by with each parameter: two shifts, turning, scaling."""
        left, top, right, bottom = self.bounds
        across = cv2.Sobel(self.luma, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)[top:bottom, left:right]
        down = cv2.Sobel(self.luma, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)[top:bottom, left:right]
        y, x = np.mgrid[top:bottom, left:right].astype(np.float32)
        x, y = (x - self.centre[0]) / UNIT, (y - self.centre[1]) / UNIT
        each = (across, down, down * x - across * y, across * x + down * y)
        return np.stack([slope.ravel()[self.inside] for slope in each], 1).astype(np.float32)


def tracked(luma: NDArray[np.uint8], scale: float) -> Float:
    """A picture (H, W) made smaller and smoothed for tracking."""
    small = luma if scale >= 1 else cv2.resize(luma, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(small.astype(np.float32), (0, 0), BLUR)  # type: ignore[return-value]


def tracking_scale(box: FaceBox) -> float:
    """Tracked pixels a pixel, for a face of this size."""
    return min(1.0, TRACKED_SIDE / box.side)


def template_of(luma: NDArray[np.uint8], box: FaceBox) -> FaceTemplate:
    """The template that one picture (H, W) with its face gives; its coordinates are the reference's from now on."""
    scale = tracking_scale(box)
    return FaceTemplate(tracked(luma, scale), box, scale)


def align(template: FaceTemplate, small: Float, scale: float, start: Array) -> Aligned:
    """The pose of a picture, from one nearby.

    Args:
        template: what to find.
        small: the picture as `tracked` gives it.
        scale: its tracked pixels a pixel.
        start: (2, 3) pose to start from.
    """
    left, top, right, bottom = template.bounds
    size = (right - left, bottom - top)
    warp = template.tracked_warp(start, scale)
    to_region = _shift(left, top)
    forth, back = _shift(-template.centre[0], -template.centre[1]), _shift(*template.centre)
    slopes, target = template.slopes, template.target
    spread, mean = float(target.std()), float(target.mean())
    residual = np.inf
    for _ in range(ROUNDS):
        shown = cv2.warpAffine(
            small, (warp @ to_region)[:2], size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        ).ravel()[template.inside]  # fmt: skip
        gain = max(float(shown.std()) / spread, 1e-3)
        difference = (shown - shown.mean()) / gain + mean - target
        deviation = 1.4826 * float(np.median(np.abs(difference))) + 1e-3
        off = np.abs(difference) / deviation
        weight = np.where(off < OUTLIER[0], 1, OUTLIER[0] / np.maximum(off, 1e-6)) * (off < OUTLIER[1])
        weighted = slopes * weight[:, None].astype(np.float32)
        normal = (slopes.T @ weighted).astype(np.float64) + 1e-6 * np.eye(4)
        change = np.linalg.solve(normal, (weighted.T @ difference).astype(np.float64))
        step = np.eye(3)
        step[:2, 2] = change[:2]
        step[0, 0] = step[1, 1] = 1 + change[3] / UNIT
        step[1, 0], step[0, 1] = change[2] / UNIT, -change[2] / UNIT
        warp = warp @ back @ np.linalg.inv(step) @ forth
        residual = float(np.sqrt((weight * difference**2).sum() / max(weight.sum(), 1e-6)))
        if np.abs(change).sum() < CONVERGED:
            break
    return Aligned(template.pose_of(warp, scale), residual)


def locate(template: FaceTemplate, small: Float, scale: float, box: FaceBox) -> Aligned:
    """The pose of a picture of which only the face box is known: the best of a search over places and sizes.

    Args:
        template, small, scale: see `align`.
        box: what the detector found; good to a tenth of its side.
    """
    left, top, right, bottom = template.bounds
    region = template.luma[top:bottom, left:right]
    best: tuple[float, Array] | None = None
    rough = box.side / template.box.side * scale / template.scale
    for size in rough * np.array([0.86, 0.93, 1.0, 1.07, 1.15]):
        patch = cv2.resize(region, None, fx=size, fy=size, interpolation=cv2.INTER_AREA)
        x = (box.x + REGION[0] * box.side) * scale
        y = (box.y + REGION[1] * box.side) * scale
        reach = round(0.15 * box.side * scale)
        x0, y0 = max(0, round(x) - reach), max(0, round(y) - reach)
        window = small[y0 : round(y) + patch.shape[0] + reach, x0 : round(x) + patch.shape[1] + reach]
        if window.shape[0] < patch.shape[0] or window.shape[1] < patch.shape[1]:
            continue
        _, score, _, place = cv2.minMaxLoc(cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED))
        warp = np.array([[size, 0, x0 + place[0] - size * left], [0, size, y0 + place[1] - size * top], [0, 0, 1.0]])
        if best is None or score > best[0]:
            best = score, warp
    if best is None:
        return Aligned(np.eye(3)[:2], np.inf)
    return align(template, small, scale, template.pose_of(best[1], scale))


def _shift(x: float, y: float) -> Array:
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


def _resized(scale: float) -> Array:
    """Pixel coordinates of a picture resized by `scale`: pixel centres lie at whole numbers."""
    return np.array([[scale, 0, scale / 2 - 0.5], [0, scale, scale / 2 - 0.5], [0, 0, 1.0]])
