"""Which stretches of a recording the background loop is joined from: natural motion that can go on for ever.

A passage begins and ends in a pause. The loop goes through a few passages and from each to the next (and from the last
to the first) at two pictures that look alike and move alike; there it is dissolved over a third of a second.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from app.engine.pack import FPS
from app.engine.training.corpus import Corpus

Array = NDArray[np.float64]
Mixed = list[list[tuple[int, float]]]
"""For each picture of a loop, the corpus frames it is mixed from and their shares."""

DISSOLVE = 8
"""Frames over which one stretch becomes the next."""
LEAST, WANTED = 2.0, 8.0
"""Seconds: the shortest stretch that is used, and how long a loop should be."""
BRIDGED = 0.1
"""Sides of the face box that a head may have moved over a picture that is left out."""
CUT, LEAST_CUT = 5.0, 1.0
"""A change of tiny pictures that is a cut: so many times the usual one, and at least so many levels."""
SHORTEST = 4.0
"""Seconds: where the passages do not fit each other better, the longest is played to and fro instead."""
LONGEST = 10.0
"""Seconds of a loop at most: all of it lies in memory."""
NEIGHBOURS = 12
"""Passages that a passage may be followed by in the search: those that it fits best."""
MARGIN = 16
"""Frames at both ends of a passage in which it may be left or entered, besides those of the dissolve."""
PIXEL, LEVEL = 1.0, 0.5
"""Cost of a pixel of distance between two faces, and of a level between two tiny pictures."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Frames of the corpus that the loop shows, one after the other; those of the dissolve before come on top."""

    frames: range


@dataclass(frozen=True)
class _End:
    """The frames at which a passage may be entered (or left), and what they look like."""

    numbers: NDArray[np.int64]
    looks: Array


def choose_stretches(corpus: Corpus, *, most: int) -> list[Stretch]:
    """The stretches of the loop, in order; after the last comes the first.

    Args:
        corpus: whose passages.
        most: frames that the loop may have.
    """
    looks = _looks(corpus)
    wanted = min(round(WANTED * FPS), most)
    least = LEAST * FPS + 2 * DISSOLVE
    whole = corpus.good & ~cuts(corpus)
    runs = [_longest(whole, passage.frames) for passage in corpus.passages]
    if max(map(len, runs)) < least:  # a slower camera, say: its pictures are shown twice now and then
        bridged = _unbroken(corpus)
        runs = [_longest(bridged, passage.frames) for passage in corpus.passages]
    usable = [run for run in runs if len(run) >= least] or [max(runs, key=len)]
    usable = [range(run.start, min(run.stop, run.start + most)) for run in usable]
    starts, stops = [_entry(looks, run) for run in usable], [_exit(looks, run) for run in usable]
    cost, where = _joints(starts, stops)
    lengths = np.array([len(run) - 2 * DISSOLVE - MARGIN for run in usable])

    def stretches(path: list[int]) -> list[Stretch]:
        joints = [where[here, after] for here, after in zip(path, path[1:] + path[:1], strict=True)]
        result = []
        for number, index in enumerate(path):
            entered = int(starts[index].numbers[joints[number - 1][1]])
            left = int(stops[index].numbers[joints[number][0]])
            result.append(Stretch(range(entered, max(left, entered + 1))))
        return result

    def fits(path: list[int]) -> bool:
        return sum(len(stretch.frames) for stretch in stretches(path)) <= most

    found = stretches(_cycle(cost, lengths, wanted, fits))
    if sum(len(stretch.frames) for stretch in found) >= SHORTEST * FPS:
        return found
    return _to_and_fro(max(runs, key=len), most)


def _to_and_fro(run: range, most: int) -> list[Stretch]:
    """One run forwards, then backwards: twice as long, and without a joint."""
    run = range(run.start, min(run.stop, run.start + most // 2))
    back = range(run.stop - 2, run.start, -1)
    return [Stretch(run), *([Stretch(back)] if len(back) else [])]


def _looks(corpus: Corpus) -> Array:
    """(T, D) numbers whose distance says how visible a cut between two frames would be."""
    side = corpus.layout.side
    box = corpus.layout.template.box
    centre = np.array([box.x + side / 2, box.y + side / 2])
    corners = centre + np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]]) * side
    ones = np.column_stack([corners, np.ones(4)])
    shown = np.einsum("tij,cj->tci", corpus.poses, ones).reshape(len(corpus.poses), -1) / 2
    speed = np.gradient(shown, axis=0) * 2
    small = corpus.thumbs.reshape(len(corpus.thumbs), -1).astype(np.float64)
    small = small * LEVEL / np.sqrt(small.shape[1])
    return np.column_stack([shown * PIXEL, speed * PIXEL, small])


def _longest(usable: NDArray[np.bool_], span: range) -> range:
    """The longest unbroken part of a passage."""
    inside = usable[span.start : span.stop]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    runs = [(int(stop - start), int(start)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]
    length, start = max(runs, default=(0, 0))
    return range(span.start + start, span.start + start + length)


def _unbroken(corpus: Corpus) -> NDArray[np.bool_]:
    """(T,) which frames are good, or alone between two good ones of their take: the one before is shown longer.

    Where the head is somewhere else afterwards, the film was cut: nothing goes across that.
    """
    bridged = corpus.good.copy()
    box = corpus.layout.template.box
    middle = corpus.poses @ np.array([box.x + box.side / 2, box.y + box.side / 2, 1])
    near = np.linalg.norm(middle[2:] - middle[:-2], axis=1) < BRIDGED * corpus.layout.side
    bridged[1:-1] |= corpus.good[:-2] & corpus.good[2:] & near
    bridged &= ~cuts(corpus)
    for edge in corpus.starts:
        outer = slice(max(0, int(edge) - 1), int(edge) + 1)
        bridged[outer] = corpus.good[outer]
    return bridged


def cuts(corpus: Corpus) -> NDArray[np.bool_]:
    """(T,) where the film was cut: tiny pictures change at once far more than they usually do."""
    small = corpus.thumbs.reshape(len(corpus.thumbs), -1).astype(np.float32)
    changed = np.abs(np.diff(small, axis=0, prepend=small[:1])).mean(1)
    usual = float(np.median(changed))
    found: NDArray[np.bool_] = changed > max(CUT * usual, LEAST_CUT)
    return found


def _entry(looks: Array, run: range) -> _End:
    margin = min(DISSOLVE, len(run) // 3)
    numbers = range(run.start + margin, min(run.start + margin + MARGIN, run.start + len(run) // 2))
    return _end(looks, numbers or range(run.start, run.start + 1))


def _exit(looks: Array, run: range) -> _End:
    margin = min(DISSOLVE, len(run) // 3)
    numbers = range(max(run.stop - margin - MARGIN, run.start + len(run) // 2 + 1), run.stop - margin)
    return _end(looks, numbers or range(run.stop - 1, run.stop))


def _end(looks: Array, numbers: range) -> _End:
    return _End(np.array(numbers, np.int64), looks[list(numbers)])


def _joints(starts: list[_End], stops: list[_End]) -> tuple[Array, dict[tuple[int, int], tuple[int, int]]]:
    """(n, n) cost of going from the end of one passage into the beginning of another, and at which frames."""
    count = len(starts)
    cost = np.full((count, count), np.inf)
    where: dict[tuple[int, int], tuple[int, int]] = {}
    rough = cdist([stop.looks.mean(0) for stop in stops], [start.looks.mean(0) for start in starts])
    for here in range(count):
        for after in {here, *np.argsort(rough[here])[:NEIGHBOURS].tolist()}:
            distance = np.linalg.norm(stops[here].looks[:, None] - starts[after].looks[None], axis=2)
            at = int(distance.argmin())
            where[here, after] = divmod(at, distance.shape[1])
            cost[here, after] = float(distance.min())
    return cost, where


def _cycle(cost: Array, lengths: NDArray[np.int64], wanted: int, fits: Callable[[list[int]], bool]) -> list[int]:
    """Passages in a circle that fits, as long as wanted, whose worst joint is as good as possible."""
    best: tuple[float, list[int]] | None = None
    for start in range(len(cost)):
        paths: list[tuple[float, list[int]]] = [(0.0, [start])]
        while paths:
            extended: list[tuple[float, list[int]]] = []
            for worst, path in paths:
                total = int(lengths[path].sum())
                closed = max(worst, float(cost[path[-1], start])) + 0.02 * max(0, wanted - total)
                if np.isfinite(closed) and (best is None or closed < best[0]) and fits(path):
                    best = closed, path
                if total >= wanted:
                    continue
                for after in np.flatnonzero(np.isfinite(cost[path[-1]])):
                    reached = max(worst, float(cost[path[-1], after]))
                    if int(after) not in path and (best is None or reached < best[0]):
                        extended.append((reached, [*path, int(after)]))
            paths = sorted(extended, key=lambda each: each[0])[:24]
    assert best is not None
    return best[1]


def joined(stretches: list[Stretch], corpus: Corpus) -> list[list[tuple[int, float]]]:
    """What each loop picture is mixed from: corpus frames with their shares.

    Broken frames are not shown: the good one before stays on. Nothing from beyond a longer break is mixed in.

    Args:
        stretches: in a circle.
        corpus: whose frames.
    """
    every = np.arange(len(corpus.good))
    held = np.maximum.accumulate(np.where(corpus.good, every, -1))
    new = ~_unbroken(corpus)
    new[corpus.starts[:-1]] = True
    first = np.maximum.accumulate(np.where(new, every + ~corpus.good, 0))  # of the unbroken frames around each
    frames: list[list[tuple[int, float]]] = [
        [(int(held[number]), 1.0)] for stretch in stretches for number in stretch.frames
    ]  # fmt: skip
    ends = np.cumsum([len(stretch.frames) for stretch in stretches])
    for (before, after), end in zip(pairwise([*stretches, stretches[0]]), ends, strict=True):
        entered = after.frames.start
        if abs(before.frames[-1] - entered) <= 1:  # to and fro: nothing to dissolve
            continue
        steps = min(DISSOLVE, entered - int(first[entered]), len(frames) - 1)
        for step in range(steps):
            share = (step + 1) / (steps + 1)
            place = int(end) - steps + step
            fading = [(number, kept * (1 - share)) for number, kept in frames[place]]
            frames[place] = [*fading, (int(held[entered - steps + step]), share)]
    return frames
