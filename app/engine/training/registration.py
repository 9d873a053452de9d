"""What the tracker leaves over between passages: a constant affine and the light, found on the mouth at rest.

The head turns a little differently in every clip, and a similarity on eyes and nose cannot see what that does to the
mouth. Left in, it hides in the model: one principal component is then little more than the clip's number. At rest all
mouths are one mouth, so each passage's mean picture at rest is registered to the mean of them all.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float32]
Array = NDArray[np.float64]

LEAST_RESTED = 3
"""Pictures: the mean of fewer at rest is not registered."""
ROUNDS, STEPS = 4, 3
"""Of the mean, and of each passage's registration in one round."""
MOST_SHIFT, MOST_STRETCH = 0.06, 0.12
"""Of the crop's width, and of unity: a larger correction is no correction."""
MOST_GAIN = 1.5
"""A passage brighter or darker by more than this factor shows something else."""


@dataclass(frozen=True, slots=True)
class Correction:
    """How the crops of one passage become like the others'.

    Attributes:
        warp: (2, 3) affine from the common crop's coordinates to this passage's.
        gain, bias: luma of this passage = gain * common + bias.
        tint: (2,) chroma of this passage minus the common one.
    """

    warp: Array
    gain: float = 1.0
    bias: float = 0.0
    tint: tuple[float, float] = (0.0, 0.0)

    def undo(self, flat: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
        """(..., P) planes in the common light; `size` is the number of luma pixels."""
        table = (np.arange(256) - self.bias) / self.gain
        luma = np.clip(np.rint(table), 0, 255).astype(np.uint8)[flat[..., :size]]
        quarter = size // 4
        each = [luma]
        for number, offset in enumerate(self.tint):
            plane = flat[..., size + number * quarter : size + (number + 1) * quarter]
            table = np.clip(np.rint(np.arange(256) - offset), 0, 255).astype(np.uint8)
            each.append(table[plane])
        return np.concatenate(each, -1)


UNCORRECTED = Correction(np.eye(3)[:2])


def register(
    rest: NDArray[np.uint8], rested: NDArray[np.int64], mask: Float, *, common: Float | None = None
) -> tuple[list[Correction], Float]:
    """Register mean pictures at rest to each other.

    Args:
        rest: (S, P) planes of the mean at rest in every passage.
        rested: (S,) of how many pictures.
        mask: (h, w) where they are compared.
        common: (P,) what to register to; the mean of all if there is none, found along with the corrections.

    Returns:
        a correction for every passage, and the common picture (P,).
    """
    height, width = mask.shape
    size = width * height
    used = np.flatnonzero(rested >= LEAST_RESTED)
    if not len(used):
        return [UNCORRECTED] * len(rest), np.zeros(rest.shape[1], np.float32) if common is None else common
    luma = rest[:, :size].reshape(-1, height, width).astype(np.float32)
    mean = luma[used].mean(0) if common is None else common[:size].reshape(height, width)
    warps = [np.eye(3)[:2] for _ in rest]
    lights = [(1.0, 0.0)] * len(rest)
    rounds, steps = (ROUNDS, STEPS) if common is None else (1, ROUNDS * STEPS)
    for _ in range(rounds):
        for index in used:
            warps[index], lights[index] = _register(luma[index], mean, mask, warps[index], steps)
        usual = float(np.median([lights[index][0] for index in used])) if common is None else 1.0
        fit = [index for index in used if _plausible(warps[index], lights[index][0] / usual, (width, height))]
        if common is None and fit:
            # The light of those that fit, on average: the mean before may have been darkened by one that does not.
            gain, bias = np.mean([lights[index] for index in fit], 0).tolist()
            for index in fit:
                own = lights[index][0] / gain
                lights[index] = own, lights[index][1] - own * bias
            aligned = [(_warped(luma[index], warps[index]) - lights[index][1]) / lights[index][0] for index in fit]
            mean = np.mean(aligned, 0).astype(np.float32)
    weight = cv2.resize(mask, (width // 2, height // 2), interpolation=cv2.INTER_AREA).ravel().astype(np.float64)
    weight /= weight.sum()
    tints = rest[:, size:].reshape(len(rest), 2, -1) @ weight
    if common is None:
        alike = fit or list(used)
        middle = tints[alike].mean(0)
        chroma = rest[alike, size:].astype(np.float32) - np.repeat(tints[alike] - middle, size // 4, axis=1)
        common = np.concatenate([mean.ravel(), chroma.mean(0)]).astype(np.float32)
    else:
        middle = common[size:].reshape(2, -1) @ weight
    corrections = [UNCORRECTED] * len(rest)
    for index in fit:
        blue, red = (tints[index] - middle).tolist()
        corrections[index] = Correction(warps[index], *lights[index], (blue, red))
    return corrections, common


def _register(luma: Float, mean: Float, mask: Float, warp: Array, steps: int) -> tuple[Array, tuple[float, float]]:
    """One picture's affine to the mean, with gain and bias, by robust Gauss-Newton steps from a start."""
    height, width = mean.shape
    across = cv2.Sobel(mean, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8).ravel()
    down = cv2.Sobel(mean, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8).ravel()
    y, x = np.mgrid[:height, :width].astype(np.float32)
    centre, unit = np.array([(width - 1) / 2, (height - 1) / 2]), width / 4
    u, v = ((x - centre[0]) / unit).ravel(), ((y - centre[1]) / unit).ravel()
    slopes = np.stack([across, down, across * u, across * v, down * u, down * v, mean.ravel(), np.ones_like(u)], 1)
    gain, bias = 1.0, 0.0
    for _ in range(steps):
        shown = _warped(luma, warp).ravel()
        difference = shown - mean.ravel()
        deviation = 1.4826 * float(np.median(np.abs(difference[mask.ravel() > 0.5]))) + 0.1
        off = np.abs(difference) / deviation
        weight = np.where(off < 2, 1, 2 / np.maximum(off, 1e-6)) * mask.ravel()
        weighted = slopes * weight[:, None]
        normal = slopes.T.astype(np.float64) @ weighted + 1e-3 * np.eye(8)
        change = np.linalg.solve(normal, weighted.T.astype(np.float64) @ difference)
        linear = change[2:6].reshape(2, 2) / unit
        step = np.eye(3)
        step[:2, :2] += linear
        step[:2, 2] = change[:2] - linear @ centre
        warp = (np.vstack([warp, [0, 0, 1]]) @ np.linalg.inv(step))[:2]
        gain, bias = 1 + float(change[6]), float(change[7])
    return warp, (gain, bias)


def _warped(luma: Float, warp: Array) -> Float:
    size = (luma.shape[1], luma.shape[0])
    return cv2.warpAffine(  # type: ignore[return-value]
        luma, warp, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    )


def _plausible(warp: Array, gain: float, size: tuple[int, int]) -> bool:
    centre = np.array(size) / 2
    shift = float(np.linalg.norm(warp[:, :2] @ centre + warp[:, 2] - centre))
    stretch = float(np.abs(warp[:, :2] - np.eye(2)).max())
    return shift < MOST_SHIFT * size[0] and stretch < MOST_STRETCH and 1 / MOST_GAIN < gain < MOST_GAIN
