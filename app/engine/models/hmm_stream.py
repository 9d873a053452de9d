"""One stream of the audio-visual models: a tree for each slot of a phone, and a diagonal Gaussian at each leaf."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from app.engine.models.hmm_context import COLUMNS, Labels, questions
from app.engine.models.hmm_states import MOST, SLOTS, SPEECH, slots_of
from app.engine.models.hmm_tree import Statistics, Tree, grow
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Flags = NDArray[np.bool_]

FLOOR = 0.01
"""Of a variance, as a share of that of all rows (as HTS has it)."""
LEAST = 40
"""Rows of a leaf: five frames."""


@dataclass(frozen=True)
class Stream:
    """Tied states of one stream.

    Attributes:
        trees: one for each slot.
        mean, variance: (L, D) of all leaves, those of the first tree first.
    """

    trees: tuple[Tree, ...]
    mean: Array
    variance: Array

    @property
    def spoken(self) -> int:
        """How many of the Gaussians are those of speech; the others are of silence."""
        return sum(tree.leaves for tree in self.trees[:SPEECH])

    def rounded(self) -> Stream:
        """The same as it is stored, in float32."""
        return Stream(self.trees, *(each.astype(np.float32).astype(np.float64) for each in (self.mean, self.variance)))

    def leaves(self, contexts: Labels) -> Numbers:
        """(N, MOST) Gaussian of each state of phones; 0 where there is none."""
        firsts, counts = slots_of(contexts)
        offsets = np.cumsum([0, *(tree.leaves for tree in self.trees)])
        answers = questions().answers(contexts)
        found = np.zeros((len(contexts), MOST), np.int64)
        for slot, tree in enumerate(self.trees):
            mine = np.flatnonzero((firsts <= slot) & (slot < firsts + counts))
            if len(mine):
                found[mine, slot - firsts[mine]] = offsets[slot] + tree.leaf(answers[:, mine])
        return found


@dataclass(frozen=True)
class Gathered:
    """What one stream showed in each state of each context.

    Attributes:
        contexts: (U, columns) that differ.
        slot: (G,) of each group of rows.
        context: (G,) row of `contexts` of each group.
        statistics: of the G groups.
        floor: (D,) of variances.
    """

    contexts: Labels
    slot: Numbers
    context: Numbers
    statistics: Statistics
    floor: Array


def gathered(contexts: Labels, states: Numbers, rows: Array, usable: Flags) -> Gathered:
    """Statistics of rows.

    Args:
        contexts: (N, columns) of phones.
        states: (N, MOST) rows of every state; all together are R.
        rows: (R, D).
        usable: (R,) which of them count.
    """
    unique, which = np.unique(contexts, axis=0, return_inverse=True)
    firsts, _ = slots_of(contexts)
    group = (which.reshape(-1)[:, None] * SLOTS + firsts[:, None] + np.arange(MOST)).ravel()
    owner = np.repeat(group, states.ravel())[usable]
    kept, place = np.unique(owner, return_inverse=True)
    picked = rows[usable]
    sums = csr_matrix((np.ones(len(place)), (place, np.arange(len(place)))), shape=(len(kept), len(place)))
    statistics = Statistics(
        np.bincount(place, minlength=len(kept)).astype(np.float64),
        np.asarray(sums @ picked),
        np.asarray(sums @ picked**2),
    )
    return Gathered(unique, kept % SLOTS, kept // SLOTS, statistics, np.maximum(FLOOR * picked.var(0), 1e-10))


def grown(found: Gathered, *, penalty: float, columns: Sequence[int] = range(len(COLUMNS))) -> tuple[Tree, ...]:
    """A tree for each slot, that asks about some columns of the context only."""
    answers = questions().answers(found.contexts) & np.isin(questions().column, columns)[:, None]
    trees = []
    for slot in range(SLOTS):
        mine = np.flatnonzero(found.slot == slot)
        trees.append(
            grow(
                found.statistics.taken(mine), answers[:, found.context[mine]], found.floor, penalty=penalty, least=LEAST
            )
        )
    return tuple(trees)


def tied(found: Gathered, trees: tuple[Tree, ...]) -> Stream:
    """Gaussians of the leaves of some trees."""
    answers = questions().answers(found.contexts)
    whole = found.statistics.summed(np.ones((1, len(found.slot)), bool))
    mean, variance = [], []
    for slot, tree in enumerate(trees):
        mine = np.flatnonzero(found.slot == slot)
        leaf = tree.leaf(answers[:, found.context[mine]])
        sums = found.statistics.taken(mine).summed(leaf == np.arange(tree.leaves)[:, None])
        empty = (sums.count < 1)[:, None]  # of a slot that was never passed
        count = np.maximum(sums.count, 1)[:, None]
        mean.append(np.where(empty, whole.total / whole.count, sums.total / count))
        variance.append(np.where(empty, whole.variance(found.floor), sums.variance(found.floor)))
    return Stream(trees, np.concatenate(mean), np.concatenate(variance))


def stored_stream(stream: Stream, name: str) -> dict[str, NDArray[Any]]:
    """Arrays of a stream, their names beginning with `name`; trees one after the other."""
    return {
        f"{name}_nodes": np.array([len(tree.question) for tree in stream.trees]),
        f"{name}_question": np.concatenate([tree.question for tree in stream.trees]).astype(np.int16),
        f"{name}_yes": np.concatenate([tree.yes for tree in stream.trees]).astype(np.int16),
        f"{name}_no": np.concatenate([tree.no for tree in stream.trees]).astype(np.int16),
        f"{name}_mean": stream.mean.astype(np.float32),
        f"{name}_variance": stream.variance.astype(np.float32),
    }


def load_stream(stored: StoredArrays, name: str, size: int) -> Stream:
    """The stream of `stored_stream`, with Gaussians of `size` dimensions.

    Raises:
        BadPack: they are not what they should be.
        KeyError: one is missing.
    """
    nodes = _whole(stored, f"{name}_nodes", (SLOTS,))
    question, yes, no = (_whole(stored, f"{name}_{part}", (int(nodes.sum()),)) for part in ("question", "yes", "no"))
    trees = []
    for first, count in zip(np.cumsum(nodes) - nodes, nodes, strict=True):
        part = slice(first, first + count)
        tree = Tree(question[part], yes[part], no[part], np.zeros(count))
        if not tree.is_sound(len(questions().column)):
            raise BadPack(f"{stored.where}: {name} holds a tree that is none")
        trees.append(tree)
    mean = stored.exact(f"{name}_mean", (sum(tree.leaves for tree in trees), size))
    variance = stored.exact(f"{name}_variance", mean.shape)
    if not (variance > 0).all():
        raise BadPack(f"{stored.where}: {name}_variance is not positive")
    return Stream(tuple(trees), mean, variance)


def _whole(stored: StoredArrays, name: str, shape: tuple[int, ...]) -> Numbers:
    numbers = stored.exact(name, shape)
    if not (numbers == np.round(numbers)).all() or np.abs(numbers).max(initial=0) > 2**31:
        raise BadPack(f"{stored.where}: {name} holds no whole numbers")
    return numbers.astype(np.int64)
