"""How well the head was held still: what the tracker found, and what is left of the nose's motion.

The mouth moves, the nostrils hardly do, and the tracker does not follow them alone. So the nose is looked for in the
pictures as recorded and in the stabilised ones: how far it is off its place on the passage's mean is what the head does
before and after.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.frame import planes
from app.engine.pack import FPS
from app.engine.training.background_loop import crop_warp
from app.engine.training.corpus import Corpus
from app.engine.training.footage import shots

Float = NDArray[np.float32]
Array = NDArray[np.float64]

SAMPLED = 900
"""Pictures in which the nose is looked for at most."""
LEAST, LONGEST = 25, 75
"""Pictures of one passage: its mean is a mean of at least, and at most, so many, from its beginning."""
EARLY = 60.0
"""Seconds: passages that begin later in their file are not looked at; all before is decoded."""
NOSE = (-0.13, 0.45, 0.13, 0.65)
"""Left and right from the middle of the face, top and bottom from the top of its box, in sides of the box."""
STEPS = 6
REACH = 0.10
"""Sides of the face box by which the nose is looked for around its place."""


@dataclass(frozen=True)
class HeadMotion:
    """How the head moves within clips, as the tracker found it: 95th percentiles over all pictures.

    Attributes:
        shift: pixels between the face's middle and its mean place in the clip.
        turn: degrees between its angle and the clip's mean one.
        growth: share by which its size differs from the clip's mean one.
        between: pixels between the middles of two following pictures' faces.
    """

    shift: float
    turn: float
    growth: float
    between: float


@dataclass(frozen=True)
class NoseMotion:
    """How far the nose is from its place on the passage's mean, pixels of the recording's reference picture.

    Attributes:
        before: (n,) in pictures as recorded.
        after: (n,) in the same, stabilised.
    """

    before: Array
    after: Array


def head_motion(corpus: Corpus) -> HeadMotion:
    """What the tracker found in the good pictures."""
    box = corpus.layout.template.box
    middle = np.array([box.x + box.side / 2, box.y + box.side / 2, 1])
    centres = corpus.poses @ middle
    turns = np.degrees(np.arctan2(corpus.poses[:, 1, 0], corpus.poses[:, 0, 0]))
    sizes = np.hypot(corpus.poses[:, 0, 0], corpus.poses[:, 1, 0])
    shift, turn, growth, between = [], [], [], []
    for start, stop in zip(corpus.starts[:-1], corpus.starts[1:], strict=True):
        good = np.flatnonzero(corpus.good[start:stop]) + start
        if not len(good):
            continue
        shift.append(np.linalg.norm(centres[good] - centres[good].mean(0), axis=1))
        turn.append(np.abs(turns[good] - turns[good].mean()))
        growth.append(np.abs(sizes[good] / sizes[good].mean() - 1))
        follows = good[1:][np.diff(good) == 1]
        between.append(np.linalg.norm(centres[follows] - centres[follows - 1], axis=1))
    return HeadMotion(*(_percentile(np.concatenate(each)) for each in (shift, turn, growth, between)))


def _percentile(values: Array) -> float:
    return float(np.percentile(values, 95)) if len(values) else 0.0


def nose_motion(corpus: Corpus) -> NoseMotion | None:
    """The nose in a sample of passages; None if no passage has enough good pictures."""
    early = [number for number, passage in enumerate(corpus.passages) if passage.first < EARLY * FPS]
    count = min(len(early), SAMPLED // LONGEST)
    chosen = [early[place] for place in np.linspace(0, len(early) - 1, count).round().astype(int)]
    by_take: dict[int, list[int]] = {}
    for number in dict.fromkeys(chosen):
        by_take.setdefault(corpus.passages[number].take, []).append(number)
    found = [motion for take, numbers in sorted(by_take.items()) for motion in _noses_of(corpus, take, numbers)]
    if not found:
        return None
    return NoseMotion(np.concatenate([each.before for each in found]), np.concatenate([each.after for each in found]))


def _noses_of(corpus: Corpus, take: int, chosen: list[int]) -> Iterator[NoseMotion]:
    """The nose in the beginnings of some passages of one take, which is decoded once."""
    start = int(corpus.starts[take])
    owner: dict[int, int] = {}
    warps: dict[int, Array] = {}
    usual: dict[int, Array] = {}
    for number in chosen:
        frames = [frame for frame in corpus.passages[number].frames[:LONGEST] if corpus.good[frame]]
        if len(frames) >= LEAST:
            for frame in frames:
                owner[frame] = number
                warps[frame] = crop_warp(corpus.poses[frame], corpus.crop, corpus.corrections[number])
            usual[number] = np.mean([warps[frame] for frame in frames], 0)
    recorded: dict[int, list[Float]] = {number: [] for number in usual}
    steady: dict[int, list[Float]] = {number: [] for number in usual}
    if owner:
        for at, shot in enumerate(islice(shots(corpus.takes[take].video), max(owner) - start + 1)):
            number = owner.get(start + at, -1)
            if number >= 0:
                luma = planes(shot.picture)[0]
                recorded[number].append(_window(corpus, luma, usual[number]))
                steady[number].append(_window(corpus, luma, warps[start + at]))
    for number in usual:
        if recorded[number]:
            yield NoseMotion(shifts(recorded[number], _margin(corpus)), shifts(steady[number], _margin(corpus)))


def _margin(corpus: Corpus) -> int:
    return max(3, round(REACH * corpus.layout.side))


def _window(corpus: Corpus, luma: NDArray[np.uint8], warp: Array) -> Float:
    """The nose and what is around it, cut from a picture (H, W) by a map from the crop to it."""
    box, side, margin = corpus.layout.template.box, corpus.layout.side, _margin(corpus)
    left = box.x + box.side / 2 + NOSE[0] * side - corpus.crop.x - margin
    top = box.y + NOSE[1] * side - corpus.crop.y - margin
    width, height = round((NOSE[2] - NOSE[0]) * side) + 2 * margin, round((NOSE[3] - NOSE[1]) * side) + 2 * margin
    place = np.vstack([warp, [0, 0, 1]]) @ np.array([[1, 0, left], [0, 1, top], [0, 0, 1.0]])
    return cv2.warpAffine(  # type: ignore[return-value]
        luma.astype(np.float32), place[:2], (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip


def shifts(windows: list[Float], margin: int) -> Array:
    """(n,) pixels by which each of some windows (h, w) is off its place on their mean.

    The best whole pixel by normalised correlation, then Gauss-Newton steps in shift, gain and brightness.
    """
    mean = np.mean(windows, 0).astype(np.float32)
    middle = mean[margin:-margin, margin:-margin]
    down, across = np.gradient(middle)
    slopes = np.stack([across.ravel(), down.ravel(), middle.ravel(), np.ones(middle.size)], 1).astype(np.float64)
    step = np.linalg.pinv(slopes)
    found = []
    for window in windows:
        score = cv2.matchTemplate(window, middle, cv2.TM_CCOEFF_NORMED)
        row, column = divmod(int(score.argmax()), score.shape[1])
        place = np.array([column, row], np.float64)
        for _ in range(STEPS):
            centre = place + (np.array(middle.shape[::-1]) - 1) / 2
            shown = cv2.getRectSubPix(window, middle.shape[::-1], tuple(centre.tolist()))
            place = np.clip(place - np.clip(step @ (shown - middle).ravel(), -1, 1)[:2], 0, 2 * margin)
        found.append(place)
    moved = np.stack(found)
    off: Array = np.linalg.norm(moved - moved.mean(0), axis=1)
    return off
