"""How well an aligner's words agree with the times that a corpus brings along."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher

import numpy as np

from app.align.align_clips import SpokenClip
from app.speech import Word

FAR = 40.0  # ms: one picture at 25 a second


@dataclass(frozen=True, slots=True)
class Starts:
    """How far starts of words or phones lie from those that are taken for right.

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
    """Starts of words compared, those at the beginning of a clip apart: there pauses decide, not neighbours.

    Attributes:
        words: words compared.
        inner: starts of all words but the first of each clip; None if there are none.
        onsets: starts of the first words; None if there are none.
    """

    words: int
    inner: Starts | None
    onsets: Starts | None


def agreement(spoken: Sequence[SpokenClip]) -> Agreement | None:
    """Compare the starts of words with those that the transcripts give.

    Words are matched in order; one that only one side has is passed over. Clips whose phones are the transcript's own
    are left out: they would agree with themselves.

    Returns:
        None if there is nothing to compare.
    """
    inner: list[float] = []
    onsets: list[float] = []
    for clip in spoken:
        if clip.given is None or not clip.aligner:
            continue
        for number, ours, theirs in _matches(clip.words, clip.given):
            (inner if number else onsets).append(1000 * (ours.start - theirs.start))
    words = len(inner) + len(onsets)
    return Agreement(words, starts(inner), starts(onsets)) if words else None


def _matches(words: Sequence[Word], given: Sequence[Word]) -> Iterator[tuple[int, Word, Word]]:
    """Number of a given word, the word that matches it, and itself."""
    ours, theirs = ([word.text.casefold() for word in each] for each in (words, given))
    for block in SequenceMatcher(None, ours, theirs, autojunk=False).get_matching_blocks():
        for at in range(block.size):
            yield block.b + at, words[block.a + at], given[block.b + at]


def starts(errors: Sequence[float]) -> Starts | None:
    """Statistics of signed distances in milliseconds; None of none."""
    if not errors:
        return None
    distances = np.abs(errors)
    return Starts(
        len(errors),
        float(np.median(distances)),
        float(np.percentile(distances, 90)),
        float(np.median(errors)),
        float(np.mean(distances > FAR)),
    )
