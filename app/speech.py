"""The one timeline that every part of the house shares: phones, words, and the sound they belong to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SILENCE = "SIL"

PHONES: tuple[str, ...] = (
    "AA", "AE", "AH", "AO", "AW", "AY", "B", "CH", "D", "DH", "EH", "ER", "EY", "F", "G", "HH",
    "IH", "IY", "JH", "K", "L", "M", "N", "NG", "OW", "OY", "P", "R", "S", "SH", "T", "TH", "UH",
    "UW", "V", "W", "Y", "Z", "ZH", SILENCE,
)  # fmt: skip
"""ARPAbet without stress, plus silence: the phone set used everywhere inside."""


@dataclass(frozen=True, slots=True)
class Phone:
    """One phone and when it sounds.

    Attributes:
        symbol: ARPAbet without stress, or ``SIL``.
        start: seconds from the first sample of the speech it belongs to.
        end: seconds; the next phone starts here.
    """

    symbol: str
    start: float
    end: float


@dataclass(frozen=True, slots=True)
class Word:
    """One written word and when it sounds (seconds, as in `Phone`)."""

    text: str
    start: float
    end: float


@dataclass(frozen=True, slots=True)
class Mark:
    """A place in a text that its writer has named (SSML ``mark``), and when it is reached (seconds, as in `Phone`)."""

    name: str
    time: float


@dataclass(frozen=True, slots=True)
class Speech:
    """Sound with its phones and words.

    Attributes:
        samples: mono waveform, float32 in [-1, 1], shape (n,).
        rate: samples a second.
        phones: gapless, from 0 to the end of the samples, silences included. None at all: whoever made the sound does
            not know them (only between a speech engine and `app.tts.timed`).
        words: in order of time; gaps are allowed. A word belongs to the piece of speech in which it begins; its end may
            lie behind that of the piece.
        unread: pieces of the text that the engine could not read and left out.
        around: the phones with those that sound shortly before and after, in seconds from the first sample, so from
            less than 0 on to behind the end: live sound is cut in the middle of words. Empty if nothing is known.
        marks: in order of time.
        ahead: what sounds after the samples, as far as it is known and matters to how the mouth moves already: (m,)
            samples; None if nothing is known.
        recognised: the phones were heard in the sound, nobody knew the text.
    """

    samples: NDArray[np.float32]
    rate: int
    phones: tuple[Phone, ...]
    words: tuple[Word, ...] = ()
    unread: tuple[str, ...] = ()
    around: tuple[Phone, ...] = ()
    marks: tuple[Mark, ...] = ()
    ahead: NDArray[np.float32] | None = None
    recognised: bool = False

    @property
    def duration(self) -> float:
        """Length of the sound in seconds."""
        return len(self.samples) / self.rate
