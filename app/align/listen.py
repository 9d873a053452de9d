"""A recording of the caller's, with its text or without, as speech for an avatar."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import soxr
from numpy.typing import NDArray

from app.align.aligner import DOUBTFUL, Aligner
from app.align.dictionary import NO_LEXICON, Lexicon
from app.align.recogniser import RATE, Recogniser, recognise
from app.errors import InputError
from app.speech import SILENCE, Phone, Speech, Word

OUT_RATE = 48_000
"""Samples a second of the speech: what streams are made of, so that it is resampled once and not piece by piece."""

SHORTEST_PIECE, LONGEST_PIECE = 1.0, 4.0
"""Seconds of a piece; it ends in a pause if there is one then."""
AROUND = 0.5
"""Seconds before and after a piece whose phones it brings along."""


@dataclass(frozen=True, slots=True)
class Listened:
    """A recording that has been listened to.

    Attributes:
        speech: all of it.
        guessed: words of the text whose pronunciation no dictionary has; see `app.align.aligner.Alignment`.
        confidence: 0 to 1, how well the text fits; under `DOUBTFUL` it probably is another one. None without a text.
    """

    speech: Speech
    guessed: tuple[str, ...] = ()
    confidence: float | None = None

    @property
    def doubtful(self) -> bool:
        """The text is probably not what is said."""
        return self.confidence is not None and self.confidence < DOUBTFUL


def align_recording(
    samples: NDArray[np.float32],
    rate: int,
    text: str,
    aligner: Aligner,
    *,
    strict: bool = False,
    lexicon: Lexicon = NO_LEXICON,
) -> Listened:
    """Find the phones and words of a text in a recording; blocks.

    Args:
        samples: mono waveform in [-1, 1], shape (n,).
        rate: samples a second.
        text: all that is said.
        aligner: finds it.
        strict: refuse a text that is probably not what is said.
        lexicon: how some of its words are said.

    Raises:
        InputError: it is (`strict`); or the sound cannot be aligned.
        NothingToSay: the text has no word that sounds.
        AlignmentFailed: the aligner found nothing or broke down.
    """
    found = aligner.align(samples, rate, text, lexicon=lexicon)
    listened = Listened(_speech(samples, rate, found.phones, found.words), found.guessed, found.confidence)
    if strict and listened.doubtful:
        raise InputError(
            f"the text does not seem to be what is said (confidence {found.confidence:.2f})",
            field="text",
            advice="Correct the text, leave it out, or do without strict.",
        )
    return listened


def recognise_recording(samples: NDArray[np.float32], rate: int, recogniser: Recogniser) -> Listened:
    """Hear the phones of a recording whose text is not known; blocks. There are no words.

    Raises:
        RecognitionFailed: the recogniser broke down.
    """
    sound = samples if rate == RATE else soxr.resample(samples, rate, RATE)
    return Listened(replace(_speech(samples, rate, recognise(recogniser, sound), ()), recognised=True))


def _speech(samples: NDArray[np.float32], rate: int, phones: tuple[Phone, ...], words: tuple[Word, ...]) -> Speech:
    sound = samples if rate == OUT_RATE else soxr.resample(samples, rate, OUT_RATE)
    return Speech(np.clip(sound, -1.0, 1.0), OUT_RATE, phones, words)


def cut(speech: Speech) -> Iterator[Speech]:
    """Pieces of a speech that is whole, so that its first mouths are drawn while the others are still to be made.

    They follow each other without a gap, and each has the phones around it: where it was cut shows nowhere.
    """
    start = 0
    while start < len(speech.samples):
        end = _end(speech, start)
        yield _part(speech, start, end)
        start = end


def _end(speech: Speech, start: int) -> int:
    """The sample that ends a piece: in the last pause within reach, else between two phones."""
    begin = start / speech.rate
    if len(speech.samples) - start <= LONGEST_PIECE * speech.rate:
        return len(speech.samples)
    reach = [
        phone for phone in speech.phones if begin + SHORTEST_PIECE < phone.end and phone.start < begin + LONGEST_PIECE
    ]
    pauses = [phone for phone in reach if phone.symbol == SILENCE]
    if pauses:
        first = max(pauses[-1].start, begin + SHORTEST_PIECE)
        end = (first + min(pauses[-1].end, begin + LONGEST_PIECE)) / 2
    else:
        end = reach[-1].start if reach[-1].start > begin + SHORTEST_PIECE else begin + LONGEST_PIECE
    return max(start + 1, min(round(end * speech.rate), len(speech.samples)))


def _part(speech: Speech, first: int, last: int) -> Speech:
    start, end = first / speech.rate, last / speech.rate
    around = tuple(
        Phone(phone.symbol, phone.start - start, phone.end - start)
        for phone in speech.phones
        if phone.end > start - AROUND and phone.start < end + AROUND
    )
    inside = [
        Phone(phone.symbol, max(phone.start, 0.0), min(phone.end, end - start))
        for phone in around
        if phone.end > 1e-6 and phone.start < end - start - 1e-6
    ]
    inside[0] = Phone(inside[0].symbol, 0.0, inside[0].end)
    inside[-1] = Phone(inside[-1].symbol, inside[-1].start, end - start)
    words = tuple(
        Word(word.text, word.start - start, word.end - start) for word in speech.words if start <= word.start < end
    )
    ahead = speech.samples[last : last + round(AROUND * speech.rate)]
    return Speech(
        speech.samples[first:last], speech.rate, tuple(inside), words, around=around, ahead=ahead,
        recognised=speech.recognised,
    )  # fmt: skip
