"""How well an aligner's words agree with the times that a corpus brings along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.align.align_clips import SpokenClip


@dataclass(frozen=True, slots=True)
class Starts:
    """How far starts of words lie from the corpus's own.

    Attributes:
        count: how many.
        median: of the distances, milliseconds.
        p90: 90th percentile of the distances, milliseconds.
        bias: signed median, milliseconds; positive: ours are later.
        over_40: share of the distances of more than 40 ms, 0 to 1.
    """

    count: int
    median: float
    p90: float
    bias: float
    over_40: float


@dataclass(frozen=True, slots=True)
class Agreement:
    """Attributes:
    words: words compared.
    inner: starts of all words but the first of each clip; None if there are none.
    onsets: starts of the first words; None if there are none.
    """

    words: int
    inner: Starts | None
    onsets: Starts | None


def agreement(spoken: Sequence[SpokenClip]) -> Agreement | None:
    """Compare the words of clips with those given; None if there is nothing to compare."""
    raise NotImplementedError
