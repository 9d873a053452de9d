"""Which samples of a recording follow a trajectory best and join best (Wang 2010, 3.4, eq. 11-15).

The target cost of a sample is its distance to the trajectory in a space of eigen-lips (eq. 12). The cost of joining
sample p to sample q asks how much p looks like what was recorded before q, and q like what was recorded after p, by
normalised cross-correlation (eq. 13 and 14): frames that were recorded one after the other join for nothing.

The search looks a bounded time ahead, so that the start of a long piece does not depend on its end, and nothing grows
with its length but time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float32]
Numbers = NDArray[np.int64]

NEAREST = 40
"""Samples that each frame chooses from: K of 3.4.2."""
KEPT = 20
"""Of these, those that join best to the frame before."""
LOOK_AHEAD = 25
"""Frames: what is shown now is chosen with this much of what follows."""


def similarities(images: Float) -> Float:
    """(S, S) normalised cross-correlation of every two images (eq. 13).

    Args:
        images: (S, P). An image without contrast resembles none but others without.
    """
    centred = images - images.mean(1, keepdims=True)
    size = np.linalg.norm(centred, axis=1, keepdims=True)
    flat = size[:, 0] < 1e-6 * np.sqrt(images.shape[1])
    unit = centred / np.maximum(size, 1e-12)
    unit[flat] = 0
    found = unit @ unit.T
    found[np.ix_(flat, flat)] = 1
    np.clip(found, -1, 1, out=found)
    np.fill_diagonal(found, 1)
    return np.asarray(found, np.float32)


def joining_costs(similar: Float, before: Numbers, after: Numbers) -> Float:
    """(S, S) what it costs to show sample q after sample p, 0 to 2 (eq. 14).

    Args:
        similar: (S, S), see `similarities`.
        before, after: (S,) numbers of the samples recorded just before and just after each; the sample's own where
            there is none.
    """
    return np.float32(1) - np.float32(0.5) * (similar[:, before] + similar[after])


@dataclass(frozen=True)
class Search:
    """Finds the cheapest sequence of samples (eq. 15).

    Attributes:
        joins: (S, S), see `joining_costs`.
        weight: of the joining costs against target costs (the omegas of eq. 11).
        nearest: K, the first pruning.
        kept: the second pruning: how many of these stay, those that join most cheaply to a sample still in the race.
        look_ahead: frames.
    """

    joins: Float
    weight: float
    nearest: int = NEAREST
    kept: int = KEPT
    look_ahead: int = LOOK_AHEAD

    def path(self, distances: Float, start: int | None = None) -> Numbers:
        """(T,) samples to show.

        Args:
            distances: (T, S) target cost of every sample at every frame.
            start: the sample shown just before the first frame; None if there was none.
        """
        chosen = np.zeros(len(distances), np.int64)
        done = 0
        while done < len(distances):
            found = self._viterbi(distances[done : done + 2 * self.look_ahead], start)
            last = done + len(found) == len(distances)
            sure = len(found) if last else self.look_ahead
            chosen[done : done + sure] = found[:sure]
            start = int(found[sure - 1])
            done += sure
        return chosen

    def _viterbi(self, distances: Float, start: int | None) -> Numbers:
        candidates: list[Numbers] = []
        from_where: list[NDArray[np.intp]] = []
        shown = np.zeros(0, np.int64) if start is None else np.array([start], np.int64)
        total: NDArray[Any] = np.zeros(len(shown), np.float32)
        for row in distances:
            near = _lowest(row, self.nearest)
            if not len(shown):
                shown, total = near, row[near]
                candidates.append(shown)
                from_where.append(np.zeros(len(near), np.intp))
                continue
            joins = self.joins[np.ix_(shown, near)]
            stay = _lowest(joins.min(0), self.kept)
            near, joins = near[stay], joins[:, stay]
            reached = total[:, None] + np.float32(self.weight) * joins
            best = reached.argmin(0)
            total = reached[best, np.arange(len(near))] + row[near]
            shown = near
            candidates.append(near)
            from_where.append(best)
        path = np.zeros(len(distances), np.int64)
        place = int(total.argmin()) if len(total) else 0
        for frame in range(len(distances) - 1, -1, -1):
            path[frame] = candidates[frame][place]
            place = int(from_where[frame][place])
        return path


def _lowest(costs: NDArray[Any], count: int) -> Numbers:
    """Numbers of the lowest costs, the earlier of equals first, rising."""
    if count >= len(costs):
        return np.arange(len(costs))
    return np.sort(np.argpartition(costs, count - 1)[:count])
