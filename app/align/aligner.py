"""What an aligner is: it finds when the phones of a known text sound in a recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from app.align.dictionary import NO_LEXICON, Lexicon
from app.align.phoneset import Sound
from app.errors import InputError, NothingToSay
from app.speech import SILENCE, Phone, Word

DOUBTFUL = 0.5  # a lower confidence says that the text is probably not what is said


@dataclass(frozen=True, slots=True)
class Alignment:
    """Phones and words of a recording.

    Attributes:
        phones: gapless, from 0 to the end of the sound, silences included.
        words: the words as they are written, in order of time; gaps are allowed. A word without any sound (an emoji, a
            word in another script) is left out.
        guessed: written words, each once, whose pronunciation came from spelling rules or from reading a number, not
            from a dictionary: the first to look at when an alignment is bad.
        confidence: 0 to 1, how well the sound fits the text; under `DOUBTFUL` it probably is another text.
    """

    phones: tuple[Phone, ...]
    words: tuple[Word, ...]
    guessed: tuple[str, ...]
    confidence: float


@runtime_checkable
class Aligner(Protocol):
    """Finds phones in sound. `align` blocks and may be called from several threads."""

    @property
    def name(self) -> str: ...

    def align(self, samples: NDArray[np.float32], rate: int, text: str, *, lexicon: Lexicon = NO_LEXICON) -> Alignment:
        """When each phone and word of `text` sounds.

        Args:
            samples: mono waveform in [-1, 1], shape (n,).
            rate: samples a second.
            text: everything that is said, in order.
            lexicon: how some of its words are said (`app.align.dictionary.read_lexicon`).

        Raises:
            NothingToSay: the text has no word that sounds.
            InputError: the sound is empty, not finite or not mono.
            AlignmentFailed: no alignment was found, or the aligner itself broke down; names the aligner.
        """
        ...


def checked(samples: NDArray[np.float32], rate: int, text: str) -> None:
    """Refuse what no aligner can align. See `Aligner.align` for the errors."""
    if samples.ndim != 1 or not len(samples) or rate <= 0:
        raise InputError(f"sound to align must be mono and not empty: shape {samples.shape}, {rate} samples a second")
    if not np.isfinite(samples).all():
        raise InputError("sound to align has samples that are no numbers")
    if not text.strip():
        raise NothingToSay("the transcript has no words", field="text")


def assemble(
    sounds: Iterable[Sound],
    written: Sequence[str],
    duration: float,
    *,
    guessed: Iterable[str] = (),
    confidence: float = 1.0,
) -> Alignment:
    """Make an alignment of timed phones, whatever their gaps.

    Args:
        sounds: in order of time, seconds; `word` numbers into `written`. Silences may be among them or missing.
        written: the words as they are written.
        duration: of the sound in seconds; phones are clipped to it.
        guessed: see `Alignment`.
        confidence: see `Alignment`.

    Returns:
        an alignment whose phones span the sound; neighbouring silences are one.
    """
    phones: list[Phone] = []
    times: dict[int, tuple[float, float]] = {}
    at = 0.0
    for sound in sounds:
        if sound.symbol == SILENCE:
            continue
        start, end = max(at, min(sound.start, duration)), min(sound.end, duration)
        if end <= start:
            continue
        if start > at:
            phones.append(Phone(SILENCE, at, start))
        phones.append(Phone(sound.symbol, start, end))
        if sound.word >= 0:
            times[sound.word] = (times.get(sound.word, (start, end))[0], end)
        at = end
    if at < duration:
        phones.append(Phone(SILENCE, at, duration))
    words = tuple(Word(written[number], *times[number]) for number in sorted(times))
    return Alignment(tuple(phones), words, tuple(dict.fromkeys(guessed)), confidence)
