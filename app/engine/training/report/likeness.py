"""Mouths to look at: prototypes, their flows, how well the model draws them, and what its modes do."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.background import Planes
from app.engine.frame import join, to_rgb
from app.engine.metrics import psnr
from app.engine.modes import Modes, draw_crop
from app.engine.training.layout import mouth_box
from app.engine.training.train import Learnt

Float = NDArray[np.float32]
Rgb = NDArray[np.uint8]

DEVIATIONS = 2.0
"""Standard deviations by which a mode is shown to both sides of the mean."""
AMPLIFIED = 4.0
"""Times: differences are shown so much larger, about grey."""


@dataclass(frozen=True)
class Prototype:
    """A prototype and the model's drawing of it.

    Attributes:
        clip: name of its take.
        frame: of that take.
        reference: whether textures lie on its grid.
        mouth: (h, w, 3) as recorded, stabilised and in the common light.
        flow: (h, w, 2) from the reference to it, pixels.
        drawn: (h, w, 3) the model at the coefficients that it was analysed to.
        difference: (h, w) luma of the mouth minus that of the drawing.
        likeness: dB, peak signal-to-noise ratio of the two around the lips.
    """

    clip: str
    frame: int
    reference: bool
    mouth: Rgb
    flow: Float
    drawn: Rgb
    difference: Float
    likeness: float


def prototypes(learnt: Learnt) -> list[Prototype]:
    """All prototypes, in order of time."""
    corpus, appearance = learnt.corpus, learnt.appearance
    morphable, window = appearance.morphable, mouth_box(corpus.crop, corpus.layout.side)
    width, height = morphable.width, morphable.height
    found = []
    for place, number in enumerate(appearance.prototypes):
        image = np.clip(np.rint(morphable.images[place]), 0, 255).astype(np.uint8)
        drawn = draw_crop(appearance.modes, appearance.coefficients[number])
        luma = image[: width * height].reshape(height, width).astype(np.float32)
        take = int(np.searchsorted(corpus.starts, number, side="right")) - 1
        found.append(
            Prototype(
                clip=corpus.takes[take].name, frame=number - int(corpus.starts[take]),
                reference=place == morphable.reference, mouth=to_rgb(image.reshape(height * 3 // 2, width)),
                flow=morphable.flows[place], drawn=rgb_of(drawn), difference=luma - drawn.luma,
                likeness=float(psnr(drawn.luma[None], luma[None], window)[0]),
            )
        )  # fmt: skip
    return found


def rgb_of(drawn: Planes) -> Rgb:
    """A drawing as RGB."""
    return to_rgb(join(*drawn.each()))


def shown_difference(difference: Float) -> Rgb:
    """A difference (h, w) as RGB, grey where there is none."""
    grey = np.clip(np.rint(128 + AMPLIFIED * difference), 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, 2)


def largest_motion(flows: Float) -> float:
    """Pixels: the 99.5th percentile of the motion in flows (N, H, W, 2)."""
    return max(1e-3, float(np.percentile(np.hypot(flows[..., 0], flows[..., 1]), 99.5)))


def flow_colours(flow: Float, largest: float) -> Rgb:
    """A flow (H, W, 2) as RGB: its direction as hue, its length as saturation.

    Args:
        flow: pixels.
        largest: length of full saturation, pixels.
    """
    hue = (np.degrees(np.arctan2(flow[..., 1], flow[..., 0])) % 360).astype(np.float32)
    length = np.clip(np.hypot(flow[..., 0], flow[..., 1]) / largest, 0, 1).astype(np.float32)
    colours = cv2.cvtColor(np.stack([hue, length, np.ones_like(hue)], -1), cv2.COLOR_HSV2RGB)
    return np.rint(colours * 255).astype(np.uint8)


def colour_wheel(side: int = 96) -> Rgb:
    """(side, side, 3) what the colours of `flow_colours` mean: motion from the middle to each place."""
    y, x = np.mgrid[:side, :side].astype(np.float32) * 2 / (side - 1) - 1
    wheel = flow_colours(np.stack([x, y], -1), 1.0)
    wheel[np.hypot(x, y) > 1] = 255
    return wheel


@dataclass(frozen=True)
class ShownMode:
    """A mode at both its ends.

    Attributes:
        share: of the variance of all flow modes, or of all texture modes.
        low, high: (h, w, 3) the mean mouth minus and plus `DEVIATIONS` standard deviations of it.
    """

    share: float
    low: Rgb
    high: Rgb


@dataclass(frozen=True)
class ShownModes:
    """The first modes.

    Attributes:
        mean: (h, w, 3) the mean mouth of the recording.
        flow, texture: by falling variance.
    """

    mean: Rgb
    flow: tuple[ShownMode, ...]
    texture: tuple[ShownMode, ...]


def shown_modes(modes: Modes, coefficients: Float, *, count: int = 6) -> ShownModes:
    """Draw the first modes.

    Args:
        modes: of the avatar.
        coefficients: (n, K) of the frames learnt from.
        count: how many of each kind.
    """
    mean, deviation = coefficients.mean(0), coefficients.std(0)
    groups = []
    for places in (range(modes.flow_count), range(modes.flow_count, modes.count)):
        total = max(float((deviation[list(places)] ** 2).sum()), 1e-12)
        groups.append(tuple(_shown(modes, mean, deviation, place, total) for place in places[:count]))
    return ShownModes(rgb_of(draw_crop(modes, mean)), *groups)


def _shown(modes: Modes, mean: Float, deviation: Float, place: int, total: float) -> ShownMode:
    moved = np.zeros_like(mean)
    moved[place] = DEVIATIONS * deviation[place]
    low, high = (rgb_of(draw_crop(modes, (mean + sign * moved).astype(np.float32))) for sign in (-1, 1))
    return ShownMode(float(deviation[place]) ** 2 / total, low, high)
