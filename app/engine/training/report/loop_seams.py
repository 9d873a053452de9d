"""What the background loop is joined from, and how well its pictures follow each other."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.background import Background
from app.engine.frame import planes, to_rgb
from app.engine.training.background_loop import crop_warp, pose_map
from app.engine.training.corpus import Corpus
from app.engine.training.stretches import DISSOLVE
from app.engine.training.train import plan_loop
from app.errors import TrainingFailed

Array = NDArray[np.float64]
Rgb = NDArray[np.uint8]

CLOSE = 0.5
"""Pixels: poses of a loop that was joined from the recording are those of its pictures, rounded to half precision."""
WIDTH = 220
"""Pixels of the pictures that are shown of a seam."""


@dataclass(frozen=True)
class LoopPart:
    """A stretch of a clip in the loop.

    Attributes:
        clip: its name.
        first, last: pictures of the clip.
        until: place in the loop of the first picture after it.
    """

    clip: str
    first: int
    last: int
    until: int


def loop_parts(corpus: Corpus, background: Background) -> list[LoopPart]:
    """The stretches that the loop is joined from; none if it was given.

    Args:
        corpus: what was learnt from.
        background: the loop of the pack.
    """
    try:
        stretches, mixed = plan_loop(corpus)
    except TrainingFailed:
        return []
    if not _is_of(corpus, background, mixed):
        return []
    parts, until = [], 0
    for stretch in stretches:
        take = int(np.searchsorted(corpus.starts, stretch.frames.start, side="right")) - 1
        start = int(corpus.starts[take])
        until += len(stretch.frames)
        first, last = stretch.frames[0] - start, stretch.frames[-1] - start
        parts.append(LoopPart(corpus.takes[take].name, first, last, until))
    return parts


def _is_of(corpus: Corpus, background: Background, mixed: list[list[tuple[int, float]]]) -> bool:
    """Whether a loop shows these pictures: their heads are where the loop's are."""
    if len(mixed) != background.frames:
        return False
    stops = np.array([passage.frames.stop for passage in corpus.passages])
    for place, parts in enumerate(mixed):
        if len(parts) == 1:
            number = parts[0][0]
            passage = int(np.searchsorted(stops, number, side="right"))
            warp = crop_warp(corpus.poses[number], corpus.crop, corpus.corrections[passage])
            expected = pose_map(warp, background.region, corpus.crop)
            if (
                expected.shape != background.pose[place].shape
                or np.abs(expected - background.pose[place]).max() > CLOSE
            ):
                return False
    return True


def steps(background: Background) -> Array:
    """(L,) mean absolute difference in luma between each picture of the loop and the next, the first after the last."""
    count = background.frames
    lumas = (planes(background.pictures[place % count])[0].astype(np.int16) for place in range(count + 1))
    before = next(lumas)
    found = []
    for luma in lumas:
        found.append(float(np.abs(luma - before).mean()))
        before = luma
    return np.array(found)


def seam_pictures(background: Background, until: int) -> list[tuple[int, Rgb]]:
    """Pictures before, in and after a dissolve with their places in the loop, small.

    Args:
        background: the loop.
        until: place of the first picture after it.
    """
    places = [(until + step) % background.frames for step in (-DISSOLVE - 1, -DISSOLVE // 2 - 1, -DISSOLVE // 2 + 1, 0)]
    return [(place, _small(to_rgb(background.pictures[place]))) for place in places]


def _small(rgb: Rgb) -> Rgb:
    if rgb.shape[1] <= WIDTH:
        return rgb
    size = (WIDTH, round(rgb.shape[0] * WIDTH / rgb.shape[1]))
    return cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
