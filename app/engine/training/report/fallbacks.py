"""Which phones were heard, how often, and what is shown for those that were not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from app.engine.states import NEIGHBOUR, VISEMES, parent
from app.engine.training.corpus import Corpus
from app.engine.trajectory import nearest_state
from app.speech import PHONES, SILENCE

FEW = 5
"""Times: a phone that was heard less often is known badly."""


@dataclass(frozen=True)
class Heard:
    """One phone in what was learnt from.

    Attributes:
        phone: its symbol.
        times: how often it was heard.
        contexts: beside how many classes of neighbours each of its halves was learnt.
        instead: the states that are shown for its two halves where they were not learnt; empty if they were.
    """

    phone: str
    times: int
    contexts: tuple[int, int]
    instead: tuple[str, ...]

    @property
    def rare(self) -> bool:
        """Heard, but less than `FEW` times."""
        return 0 < self.times < FEW


def heard(corpus: Corpus, states: Sequence[str]) -> list[Heard]:
    """All phones but silence, the most frequent first.

    Args:
        corpus: passages without a good frame are left out.
        states: of the trajectory model.
    """
    times = Counter(
        phone.symbol
        for passage in corpus.passages
        if corpus.good[passage.frames.start : passage.frames.stop].any()
        for phone in corpus.phones(passage)
    )
    known = set(states)
    found = [_heard(phone, times[phone], known) for phone in PHONES if phone != SILENCE]
    return sorted(found, key=lambda each: (-each.times, each.phone))


def _heard(phone: str, times: int, known: set[str]) -> Heard:
    halves = (f"{phone}.0", f"{phone}.1")
    first, second = (sum(state.startswith(half + NEIGHBOUR) for state in known) for half in halves)
    shown = [nearest_state(half, known) for half in halves]
    instead = dict.fromkeys(state for state in shown if state.partition(".")[0] != phone)
    return Heard(phone, times, (first, second), tuple(instead))


@dataclass(frozen=True)
class StateCounts:
    """How many states the trajectory model has.

    Attributes:
        halves: of phones, whatever is beside them.
        contexts: of phones beside a class of neighbours.
        possible: contexts that there could be.
        silences: of silence, by its distance to speech.
    """

    halves: int
    contexts: int
    possible: int
    silences: int


def count_states(states: Sequence[str]) -> StateCounts:
    """Count the states of a trajectory model."""
    speech = [state for state in states if not state.startswith(SILENCE)]
    contexts = sum(state != parent(state) for state in speech)
    return StateCounts(
        len(speech) - contexts, contexts, 2 * (len(PHONES) - 1) * len(VISEMES), len(states) - len(speech)
    )
