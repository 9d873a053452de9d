"""States of phones, left to right, and when each of them is passed.

Phones of speech have `SPEECH` states, silence has `QUIET_STATES`: those at its ends are what the mouth does beside
speech, the one in the middle is rest. A silence that nothing is before, or nothing after, begins or ends at rest. A
place in a phone, of speech or of silence, is a slot; states of a phone are counted from its first slot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from app.engine.models.hmm_context import QUIET, THIS, Labels
from app.speech import PHONES, Phone

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Flags = NDArray[np.bool_]

SPEECH = 3
QUIET_STATES = 7
SLOTS = SPEECH + QUIET_STATES
MOST = max(SPEECH, QUIET_STATES)
REST_SLOT = SPEECH + QUIET_STATES // 2
"""The middle of silence."""
EDGE = 10.0
"""Rows of the states at the ends of silence before anything is learnt: 50 ms at 25 fps."""
LEAST_VARIANCE = 0.25
"""Of a duration, in rows squared."""


def phone_rows(phones: Sequence[Phone], first: int, count: int, rate: float) -> Numbers:
    """(N + 1,) where the rows of each phone begin among `count` rows of which the first is number `first`.

    Row r is at r / rate seconds. The first phone reaches back to any row, the last one on to any.
    """
    edges = np.ceil(np.array([phone.start for phone in phones[1:]]) * rate - 1e-6) - first
    return np.array([0, *np.clip(edges, 0, count), count]).astype(np.int64)


def slots_of(contexts: Labels) -> tuple[Numbers, Numbers]:
    """First slot of each phone (N,), and how many it has (N,)."""
    quiet = contexts[:, THIS] == QUIET
    begins = quiet & (contexts[:, THIS - 1] == QUIET)
    ends = quiet & (contexts[:, THIS + 1] == QUIET)
    first = np.where(begins, REST_SLOT, np.where(quiet, SPEECH, 0))
    last = np.where(ends, REST_SLOT + 1, np.where(quiet, SLOTS, SPEECH))
    return first, last - first


@dataclass(frozen=True)
class Durations:
    """How long states last, in rows.

    Attributes:
        mean, variance: (len(PHONES), SLOTS), of the slots that a phone has.
    """

    mean: Array
    variance: Array

    def rounded(self) -> Durations:
        """The same as they are stored, in float32."""
        return Durations(*(each.astype(np.float32).astype(np.float64) for each in (self.mean, self.variance)))

    def states(self, contexts: Labels, lengths: Numbers) -> Numbers:
        """Rows of every state (N, MOST) of phones that are `lengths` (N,) rows long; 0 for states that are not.

        The most likely ones with that sum: mean + rho variance (Yoshimura 1998), at least one row each if there are
        enough.
        """
        found = np.zeros((len(contexts), MOST), np.int64)
        firsts, counts = slots_of(contexts)
        for at, (first, many) in enumerate(zip(firsts, counts, strict=True)):
            row = contexts[at, THIS], slice(first, first + many)
            found[at, :many] = shared_rows(self.mean[row], self.variance[row], int(lengths[at]))
        return found


def shared_rows(mean: Array, variance: Array, length: int) -> Numbers:
    """Whole numbers with the sum `length`: the most likely durations of (S,) states one after the other."""
    many = len(mean)
    if length <= many:
        even: Numbers = np.diff((np.arange(many + 1) * length + many // 2) // many)
        return even
    rows = np.ones(many)
    longer = np.ones(many, bool)
    while longer.any():  # those that would be shorter than a row get one, the others share what is left
        left = length - (~longer).sum()
        rho = (left - mean[longer].sum()) / variance[longer].sum()
        wanted = mean + rho * variance
        short = longer & (wanted < 1.0)
        if not short.any():
            rows[longer] = wanted[longer]
            break
        longer &= ~short
    # Halves always go up: to even numbers, two edges a row apart could meet.
    edges = np.floor(np.append(0.0, np.cumsum(rows)) * (length / rows.sum()) + 0.5).astype(np.int64)
    whole: Numbers = np.diff(edges)
    return whole


def even_durations() -> Durations:
    """Before anything is learnt: all alike in speech, `EDGE` at the ends of silence."""
    mean = np.ones((len(PHONES), SLOTS))
    mean[QUIET] = EDGE
    variance = np.ones_like(mean)
    variance[QUIET] = LEAST_VARIANCE
    variance[QUIET, REST_SLOT] = 1e4
    return Durations(mean, variance)


def learnt_durations(contexts: Labels, states: Numbers) -> Durations:
    """Of the rows of states (N, MOST) of phones; a phone that is rare has those of all speech."""
    even = even_durations()
    mean, variance = even.mean.copy(), even.variance.copy()
    firsts, counts = slots_of(contexts)
    speech = contexts[:, THIS] != QUIET
    for slot in range(SLOTS):
        has = (firsts <= slot) & (slot < firsts + counts)
        rows = np.take_along_axis(states, np.clip(slot - firsts, 0, MOST - 1)[:, None], 1)[:, 0]
        every = rows[has & speech] if slot < SPEECH else rows[has]
        for phone in range(len(PHONES)):
            if (phone == QUIET) != (slot >= SPEECH):
                continue
            mine = rows[has & (contexts[:, THIS] == phone)]
            seen = mine if len(mine) >= 5 else every
            if len(seen) >= 5:
                mean[phone, slot], variance[phone, slot] = max(seen.mean(), 1.0), max(seen.var(), LEAST_VARIANCE)
    return Durations(mean, variance)


@nb.njit(cache=True, nogil=True)
def align(starts: Numbers, counts: Numbers, fits: Array, states: Numbers) -> None:
    """The most likely rows of every state of phones whose bounds are known (Viterbi, left to right, no skips).

    Args:
        starts: (N + 1,) first row of each phone.
        counts: (N,) its states; phones with fewer rows are left alone.
        fits: (R, MOST) log likelihood of each row in each state of its phone.
        states: (N, MOST) rows of each state, overwritten.
    """
    for phone in range(len(counts)):
        first, rows, many = starts[phone], starts[phone + 1] - starts[phone], counts[phone]
        if rows < many:
            continue
        best = np.full(many, -np.inf)
        came = np.zeros((rows, many), np.bool_)
        best[0] = fits[first, 0]
        for t in range(1, rows):
            for s in range(many - 1, -1, -1):
                came[t, s] = s > 0 and best[s - 1] > best[s]
                best[s] = (best[s - 1] if came[t, s] else best[s]) + fits[first + t, s]
        states[phone, :] = 0
        at = many - 1
        for t in range(rows - 1, -1, -1):
            states[phone, at] += 1
            if came[t, at]:
                at -= 1


@nb.njit(cache=True, nogil=True)
def add_fits(
    starts: Numbers, counts: Numbers, leaves: Numbers, rows: Array, usable: Flags, mean: Array, variance: Array,
    fits: Array,
) -> None:  # fmt: skip
    """Add the log likelihoods of rows in each state of their phone, without what all share.

    Args:
        starts, counts: as `align` has them.
        leaves: (N, MOST) Gaussian of each state.
        rows: (R, D).
        usable: (R,) which rows say anything.
        mean, variance: (L, D).
        fits: (R, MOST), added to.
    """
    constant = 0.5 * np.log(variance).sum(1)
    precision = 1.0 / variance
    for phone in range(len(counts)):
        for t in range(starts[phone], starts[phone + 1]):
            if usable[t]:
                for s in range(counts[phone]):
                    leaf = leaves[phone, s]
                    far = 0.0
                    for d in range(rows.shape[1]):
                        far += (rows[t, d] - mean[leaf, d]) ** 2 * precision[leaf, d]
                    fits[t, s] -= constant[leaf] + 0.5 * far
