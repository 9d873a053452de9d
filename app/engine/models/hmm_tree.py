"""Decision trees that tie states of phones in context (Wang 2010, 3.2; Young 1994; description length: Shinoda 2000).

A node's contexts share one diagonal Gaussian. The question that makes what was observed the most likely splits it,
if that pays: gain > penalty x D x ln N, with D dimensions (a split adds 2 D parameters, half a logarithm each) and N
observations in the whole tree. `penalty` is 1 for the minimum description length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Statistics:
    """Of what was observed in some contexts.

    Attributes:
        count: (N,) observations.
        total: (N, D) their sum.
        squares: (N, D) the sum of their squares.
    """

    count: Array
    total: Array
    squares: Array

    def summed(self, groups: Flags) -> Statistics:
        """Those of (G, N) groups of contexts."""
        weights = groups.astype(np.float64)
        return Statistics(weights @ self.count, weights @ self.total, weights @ self.squares)

    def rest_of(self, parts: Statistics) -> Statistics:
        """What is left of one (1, D) group without each of some (G, D) parts."""
        return Statistics(self.count - parts.count, self.total - parts.total, self.squares - parts.squares)

    def taken(self, rows: Numbers) -> Statistics:
        """Those of some contexts."""
        return Statistics(self.count[rows], self.total[rows], self.squares[rows])

    def variance(self, floor: Array) -> Array:
        """(N, D), not below `floor` (D,)."""
        count = np.maximum(self.count, 1e-9)[:, None]
        return np.maximum(self.squares / count - (self.total / count) ** 2, floor)

    def likelihood(self, floor: Array) -> Array:
        """(N,) log likelihood under a Gaussian each of their own, without what no split changes."""
        found: Array = -0.5 * self.count * np.log(self.variance(floor)).sum(1)
        return found


@dataclass(frozen=True)
class Tree:
    """Splits, parents before children.

    Attributes:
        question: (M,) at each node; -1: a leaf.
        yes, no: (M,) children; -1 at leaves.
        gain: (M,) of log likelihood by the split over D ln N; what a penalty is compared with.
    """

    question: Numbers
    yes: Numbers
    no: Numbers
    gain: Array

    @property
    def leaves(self) -> int:
        """How many."""
        return int((self.question < 0).sum())

    def is_sound(self, asked: int) -> bool:
        """Whether a walk from the first node always ends at a leaf, with this many questions to ask."""
        leaf = self.question < 0
        places = np.arange(len(leaf))
        inner = (self.question < asked) & (np.minimum(self.yes, self.no) > places)
        return len(leaf) > 0 and bool((leaf | (inner & (np.maximum(self.yes, self.no) < len(leaf)))).all())

    def leaf_numbers(self) -> Numbers:
        """(M,) number of each leaf among leaves; -1 elsewhere."""
        leaf = self.question < 0
        return np.where(leaf, np.cumsum(leaf) - 1, -1)

    def leaf(self, answers: Flags) -> Numbers:
        """(N,) number of the leaf that each context falls into, from the answers (Q, N) to all questions."""
        nodes = np.zeros(answers.shape[1], np.int64)
        places = np.arange(len(nodes))
        while True:
            asked = self.question[nodes]
            inner = asked >= 0
            if not inner.any():
                break
            at = nodes[inner]
            nodes[inner] = np.where(answers[asked[inner], places[inner]], self.yes[at], self.no[at])
        return self.leaf_numbers()[nodes]

    def cut(self, penalty: float) -> Tree:
        """The tree that would have been grown with a higher penalty: each split depends on its own gain only."""
        kept: list[int] = []
        number = {0: 0}
        queue = [0]
        while queue:
            node = queue.pop(0)
            number[node] = len(kept)
            kept.append(node)
            if self.question[node] >= 0 and self.gain[node] > penalty:
                queue += [int(self.yes[node]), int(self.no[node])]
        rows = np.array(kept)
        inner = np.array([bool(self.question[node] >= 0 and self.gain[node] > penalty) for node in kept])
        child = [
            np.array([number[int(side[node])] if at else -1 for node, at in zip(kept, inner, strict=True)], np.int64)
            for side in (self.yes, self.no)
        ]
        return Tree(np.where(inner, self.question[rows], -1), child[0], child[1], np.where(inner, self.gain[rows], 0.0))


def grow(statistics: Statistics, answers: Flags, floor: Array, *, penalty: float, least: float) -> Tree:
    """Grow a tree.

    Args:
        statistics: of N contexts.
        answers: (Q, N) to all questions.
        floor: (D,) of variances.
        penalty: see above.
        least: observations that a leaf must have.
    """
    scale = statistics.total.shape[1] * np.log(max(float(statistics.count.sum()), 2.0))
    question, yes, no, gains = [-1], [-1], [-1], [0.0]
    queue = [(0, np.flatnonzero(statistics.count > 0))]
    while queue:
        node, rows = queue.pop(0)
        best, gain = best_split(statistics.taken(rows), answers[:, rows], floor, least)
        if best < 0 or gain / scale <= penalty:
            continue
        question[node], gains[node] = best, gain / scale
        for side, chosen in ((yes, answers[best, rows]), (no, ~answers[best, rows])):
            side[node] = len(question)
            queue.append((len(question), rows[chosen]))
            question.append(-1)
            yes.append(-1)
            no.append(-1)
            gains.append(0.0)
    return Tree(np.array(question), np.array(yes), np.array(no), np.array(gains))


def best_split(statistics: Statistics, answers: Flags, floor: Array, least: float) -> tuple[int, float]:
    """The question that gains the most, and how much; (-1, 0) if every one leaves a side below `least`."""
    if not len(statistics.count):
        return -1, 0.0
    # Questions that split alike are asked once: most are of no account deep in a tree.
    _, first = np.unique(np.packbits(answers, axis=1), axis=0, return_index=True)
    first = np.sort(first)
    asked = answers[first]
    count = asked @ statistics.count
    total = statistics.count.sum()
    possible = (count >= least) & (total - count >= least)
    if not possible.any():
        return -1, 0.0
    first, asked = first[possible], asked[possible]
    whole = statistics.summed(np.ones((1, len(statistics.count)), bool))
    agree = statistics.summed(asked)
    gain = agree.likelihood(floor) + whole.rest_of(agree).likelihood(floor) - whole.likelihood(floor)[0]
    best = int(np.argmax(gain))
    return int(first[best]), float(gain[best])
