"""Phones for all clips of a corpus: in parallel, with a cache, and with a reason for each clip that cannot be used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.align.aligner import Aligner
from app.align.clips import Clip
from app.speech import Phone, Word


@dataclass(frozen=True, slots=True)
class SpokenClip:
    """A clip and when its phones and words sound: seconds on the video's clock, 0 is its first picture.

    Attributes:
        clip: the clip.
        phones: gapless ARPAbet from 0 to the end of the sound, silences included.
        words: as they are written, in order of time; gaps are allowed.
        guessed: written words whose pronunciation is not from a dictionary.
        confidence: 0 to 1, how well the sound fits the text; 1 for times taken from the transcript.
        given: the words with the transcript's own times, moved to the video's clock; None if it has none.
        aligner: name of the aligner; "" if the phones are the transcript's own.
    """

    clip: Clip
    phones: tuple[Phone, ...]
    words: tuple[Word, ...]
    guessed: tuple[str, ...]
    confidence: float
    given: tuple[Word, ...] | None
    aligner: str


@dataclass(frozen=True, slots=True)
class Refused:
    """A clip that cannot be used.

    Attributes:
        clip: the clip.
        reason: what is wrong with it, in one sentence without a full stop.
        advice: what to do about it.
    """

    clip: Clip
    reason: str
    advice: str = ""


@dataclass(frozen=True, slots=True)
class Aligned:
    """What became of the clips of a corpus; both in their order."""

    spoken: tuple[SpokenClip, ...]
    refused: tuple[Refused, ...]


def align_clips(
    clips: Sequence[Clip],
    make_aligner: Callable[[], Aligner],
    *,
    cache: Path | None = None,
    workers: int = 1,
    progress: Callable[[float], None] = lambda _: None,
) -> Aligned:
    """Find the phones of all clips."""
    raise NotImplementedError
