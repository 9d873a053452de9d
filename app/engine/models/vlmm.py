"""Variable-length Markov models over phones, one label a frame (Deena 2010, 2.2 and 4.2.1; Ron, Singer, Tishby 1996).

A prediction suffix tree remembers as many labels as help to tell the next one, and is turned into a probabilistic
finite state automaton whose states are the remembered strings. Traversed over a sentence and tracked back from its end
it cuts the sentence into stretches, each of which is one of the strings.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.speech import PHONES

Array = NDArray[np.float64]
Context = tuple[str, ...]
"""A string of labels, the earliest first."""

START: Context = ()
"""The state that remembers nothing."""


class Stretch(NamedTuple):
    """Frames `start` to `stop` of a sentence, all in one state."""

    state: int
    start: int
    stop: int


@dataclass(frozen=True)
class Vlmm:
    """The automaton (Q, Sigma, tau, gamma, s); s is all on the start state, the memory being empty before a sentence.

    Attributes:
        contexts: Q, the start state first; every prefix and every suffix of one is one too.
        tokens: Sigma.
        next: gamma, (Q, Sigma) how probable each label is in each state; rows sum to 1, or to 0 where in training
            nothing ever followed.
    """

    contexts: tuple[Context, ...]
    tokens: tuple[str, ...]
    next: Array

    @cached_property
    def number(self) -> dict[Context, int]:
        """Of each state."""
        return {context: number for number, context in enumerate(self.contexts)}

    @cached_property
    def _columns(self) -> dict[str, int]:
        return {token: column for column, token in enumerate(self.tokens)}

    def step(self, state: int, token: str) -> int:
        """tau: the longest remembered suffix of the state's string with the label behind it.

        A label that never followed in training leads back to the start state, which forgets everything, and from there
        on (4.2.1).

        Raises:
            KeyError: the label is none of `tokens`.
        """
        if self.next[state, self._columns[token]] <= 0:
            return self.number[(token,)]
        string = (*self.contexts[state], token)
        return next(self.number[string[at:]] for at in range(len(string)) if string[at:] in self.number)

    def traverse(self, labels: Sequence[str]) -> list[int]:
        """The state after each label, from the start state on."""
        states, state = [], 0
        for label in labels:
            state = self.step(state, label)
            states.append(state)
        return states

    def stretches(self, labels: Sequence[str], usable: Callable[[int], bool] | None = None) -> list[Stretch]:
        """Non-overlapping states by tracking back from the last label (4.2.1), the first stretch first.

        The last state takes as many frames as it remembers labels, the state of the frame before these as many as it
        remembers, and so on. No state reaches back beyond the first frame, as none remembers what was not traversed.

        Args:
            labels: one a frame.
            usable: says of a state whether it may be taken, by itself all; if not, its parent is asked. Single labels
                always may.
        """
        states, found, stop = self.traverse(labels), [], len(labels)
        while stop > 0:
            state = states[stop - 1]
            while usable is not None and len(self.contexts[state]) > 1 and not usable(state):
                state = self.parent(state)
            start = stop - len(self.contexts[state])
            found.append(Stretch(state, start, stop))
            stop = start
        return found[::-1]

    def parent(self, state: int) -> int:
        """The state that remembers one label less."""
        return self.number[self.contexts[state][1:]]


def learn_vlmm(sequences: Sequence[Sequence[str]], *, memory: int, threshold: float) -> Vlmm:
    """Count, prune, and make the automaton.

    Args:
        sequences: labels, one a frame, of each sentence.
        memory: labels that a state remembers at most, N - 1 in the paper.
        threshold: epsilon, nats; a context is kept where its information over its parent (eq. 13) is more, or that of
            a longer context which ends in it. Single labels are always kept: every frame needs a state.
    """
    counts = Counter(
        tuple(labels[start : start + length])
        for labels in sequences
        for length in range(1, memory + 2)
        for start in range(len(labels) - length + 1)
    )
    tokens = tuple(token for token in PHONES if (token,) in counts)
    tokens += tuple(sorted({string[0] for string in counts if len(string) == 1} - set(tokens)))
    total = sum(len(labels) for labels in sequences)
    follow = _followers(counts, tokens)
    kept: set[Context] = {START} | {(token,) for token in tokens}
    for string in sorted((each for each in follow if 1 < len(each) <= memory), key=len, reverse=True):
        if string not in kept:
            gained = counts[string] / total * information(follow[string], follow[string[1:]])
            if gained <= threshold:
                continue
        kept |= {string[at:] for at in range(len(string))}
    # Ron's automaton can only reach a string step by step if its prefixes are states; these want their suffixes.
    for string in sorted(kept, key=len, reverse=True):
        for stop in range(1, len(string)):
            kept |= {string[at:stop] for at in range(stop)}
    order = {token: place for place, token in enumerate(tokens)}
    contexts = tuple(sorted(kept, key=lambda each: (len(each), [order[token] for token in each])))
    rows = np.array([_distribution(follow.get(each, np.zeros(len(tokens)))) for each in contexts])
    return Vlmm(contexts, tokens, rows)


def information(longer: Array, shorter: Array) -> float:
    """Sum of eq. 13 in nats: Kullback-Leibler divergence of what follows the longer context from what follows its end.

    Args:
        longer, shorter: (Sigma,) counts; where the longer has any, so has the shorter.
    """
    p, q = _distribution(longer), _distribution(shorter)
    there = p > 0
    return float((p[there] * np.log(p[there] / q[there])).sum())


def _followers(counts: Counter[Context], tokens: Sequence[str]) -> dict[Context, Array]:
    """Context to (Sigma,) how often each label follows it."""
    column = {token: place for place, token in enumerate(tokens)}
    follow: dict[Context, Array] = {}
    for string, count in counts.items():
        follow.setdefault(string[:-1], np.zeros(len(tokens)))[column[string[-1]]] += count
    return follow


def _distribution(counts: Array) -> Array:
    return np.asarray(counts / max(counts.sum(), 1e-300))
