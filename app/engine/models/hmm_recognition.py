"""What was said, from the sound alone: Viterbi over a loop of phones in context (Wang 2010, 3.3: the best Q given A).

Any phone may follow any other, as likely as it did in training after the two before. The context on the right is not
known while a phone is passed, so a phone after another stands in the loop once for every different row of tied states
that the phones after it would give it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from app.engine.models.hmm_context import QUIET, THIS, Labels
from app.engine.models.hmm_states import MOST, Durations, slots_of
from app.engine.models.hmm_stream import Stream

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

SHARPNESS = 0.1
"""Of likelihoods of rows: neighbours hear nearly the same and do not count whole (found on sentences left out)."""
BEAM = 25.0
"""Of log likelihood, with `SHARPNESS`: phones that are less likely than the best by more are given up."""
NEVER = 1e-30
"""Likelihood of what cannot be."""
BELIEF = 1.0
"""Strength of a history's own counts: after n of them with d different phones, n / (n + BELIEF d) of what follows."""


def phone_grammar(said: Labels, phones: Numbers) -> Array:
    """Log likelihood (P, P, P) of phone [., ., r] after [l, c, .]: counts, backed off by Witten and Bell (1991).

    Args:
        said: (N, 3) contexts of phones in training.
        phones: (P,) places in `PHONES`, silence among them; silence never follows silence.
    """
    number = {int(place): at for at, place in enumerate(phones)}
    size = len(phones)
    three = np.zeros((size, size, size))
    for last, this, following in said:
        three[number[int(last)], number[int(this)], number[int(following)]] += 1
    quiet = number[QUIET]
    three[:, quiet, quiet] = 0
    two = three.sum(0)
    likely = (two.sum(0) + 0.5) / (two.sum() + 0.5 * size)
    for counts in (two, three):
        seen, kinds = counts.sum(-1, keepdims=True), (counts > 0).sum(-1, keepdims=True)
        own = seen / np.maximum(seen + BELIEF * kinds, 1e-9)
        likely = own * counts / np.maximum(seen, 1e-9) + (1 - own) * likely
    likely[..., quiet, quiet] = 0
    likely = likely / likely.sum(-1, keepdims=True)
    grammar: Array = np.log(np.maximum(likely, NEVER)).astype(np.float32).astype(np.float64)
    return grammar


@dataclass(frozen=True)
class Loop:
    """All phones that were trained, in a loop.

    Attributes:
        phones: (P,) places in `PHONES`.
        grammar: (P, P, P) see `phone_grammar`.
        nodes: (P, P, P) number of the node that stands for phone c after l and before r.
        pairs: (M,) which l P + c each node belongs to, in this order.
        counts: (M,) states of each node.
        leaves: (M, MOST) their Gaussians.
        stay, leave: (M, MOST) log likelihood of another row in a state, and of the next state.
    """

    phones: Numbers
    grammar: Array
    nodes: Numbers
    pairs: Numbers
    counts: Numbers
    leaves: Numbers
    stay: Array
    leave: Array

    @classmethod
    def of(cls, stream: Stream, durations: Durations, phones: Numbers, grammar: Array) -> Loop:
        """The loop over what one stream of tied states hears."""
        size = len(phones)
        contexts = np.stack(np.meshgrid(phones, phones, phones, indexing="ij"), -1).reshape(-1, 3).astype(np.int16)
        leaves = stream.leaves(contexts)
        firsts, counts = slots_of(contexts)
        key = np.column_stack([np.arange(size**3) // size, counts, leaves])
        unique, first, node = np.unique(key, axis=0, return_index=True, return_inverse=True)
        slots = np.minimum(firsts[first][:, None] + np.arange(MOST), durations.mean.shape[1] - 1)
        lasting = np.maximum(durations.mean[contexts[first, THIS][:, None], slots], 1.01)
        return cls(
            phones, grammar, node.reshape(size, size, size), unique[:, 0].copy(), unique[:, 1].copy(),
            unique[:, 2:].copy(), np.log(1 - 1 / lasting), np.log(1 / lasting),
        )  # fmt: skip

    def recognise(self, fits: Array, *, beam: float = BEAM) -> tuple[Numbers, Numbers]:
        """The most likely phones.

        Args:
            fits: (R, L) log likelihood of each row under each Gaussian, R at least 1.
            beam: how much less likely than the best one a phone may be; infinite: the search is exact.

        Returns:
            (N,) places in `PHONES`, and (N + 1,) the row at which each begins, and R.
        """
        rows, size = len(fits), len(self.phones)
        came = np.zeros((rows, size * size), np.int64)
        since = np.zeros((rows, size * size), np.int64)
        last = np.zeros(2, np.int64)
        _search(
            np.ascontiguousarray(fits) * SHARPNESS, self.grammar, self.nodes, self.pairs, self.counts, self.leaves,
            self.stay, self.leave, beam, came, since, last,
        )  # fmt: skip
        node, begin = int(last[0]), int(last[1])
        said, begins = [], [rows]
        while True:
            pair = int(self.pairs[node])
            said.append(int(self.phones[pair % size]))
            begins.append(begin)
            if begin == 0:
                break
            node, begin = int(came[begin, pair]), int(since[begin, pair])
        return np.array(said[::-1]), np.array(begins[::-1])


def row_likelihoods(stream: Stream, rows: Array) -> Array:
    """(R, L) log likelihood of rows (R, D) under every Gaussian, without what all share."""
    precision = 1 / stream.variance
    constant = np.log(stream.variance).sum(1) + (stream.mean**2 * precision).sum(1)
    found: Array = -0.5 * (rows**2 @ precision.T - 2 * rows @ (stream.mean * precision).T + constant)
    return found


@nb.njit(cache=True, nogil=True)
def _search(
    fits: Array, grammar: Array, nodes: Numbers, pairs: Numbers, counts: Numbers, leaves: Numbers, stay: Array,
    leave: Array, beam: float, came: Numbers, since: Numbers, last: Numbers,
) -> None:  # fmt: skip
    """Fill `came` (R, P P): the node before that entered a pair at a row, `since` when that began, and the `last`."""
    rows, size, many = fits.shape[0], grammar.shape[0], len(pairs)
    best = np.full((many, MOST), -np.inf)
    begun = np.zeros((many, MOST), np.int64)
    alive = np.zeros(many, np.bool_)
    enter = np.zeros(size * size)
    least = -np.inf  # what is not alive has less than that
    for t in range(rows):
        if t > 0:
            enter[:] = -np.inf
            for b in range(size):
                for c in range(size):
                    for r in range(size):
                        node = nodes[b, c, r]
                        if not alive[node]:
                            continue
                        state = counts[node] - 1
                        value = best[node, state] + leave[node, state] + grammar[b, c, r]
                        if value > enter[c * size + r]:
                            enter[c * size + r] = value
                            came[t, c * size + r] = node
                            since[t, c * size + r] = begun[node, state]
        top = -np.inf
        for node in range(many):
            if not alive[node] and enter[pairs[node]] <= least:
                continue
            highest = -np.inf
            for s in range(counts[node] - 1, -1, -1):
                value, begin = best[node, s] + stay[node, s], begun[node, s]
                if s == 0:
                    if enter[pairs[node]] > value:
                        value, begin = enter[pairs[node]], t
                elif best[node, s - 1] + leave[node, s - 1] > value:
                    value, begin = best[node, s - 1] + leave[node, s - 1], begun[node, s - 1]
                best[node, s] = value + fits[t, leaves[node, s]]
                begun[node, s] = begin
                highest = max(highest, best[node, s])
            alive[node] = True
            top = max(top, highest)
        least = top - beam
        for node in range(many):
            if alive[node] and best[node].max() < least:
                alive[node] = False
                best[node] = -np.inf
    top = -np.inf
    for node in range(many):
        for s in range(counts[node]):
            if best[node, s] > top:
                top = best[node, s]
                last[0] = node
                last[1] = begun[node, s]
