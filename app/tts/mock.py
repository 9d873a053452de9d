"""A speech engine without a model: a buzz with a colour of its own for every phone, exact times, no waiting.

It speaks any text: letters by a simple table, digits as words, letters of other scripts as some phone. The same text
always makes the same samples. For tests, for trying things without a voice, and as the example for engines of your own.
"""

from __future__ import annotations

import re
import unicodedata
from functools import cache

import numpy as np
from numpy.typing import NDArray

from app.align.dictionary import NO_LEXICON, Lexicon, Pronunciation, folded
from app.errors import NotFound, NothingToSay
from app.speech import PHONES, SILENCE, Phone, Speech, Word
from app.tts.engine import Voice
from app.tts.text import fold

RATE = 24_000  # samples a second
PITCH = 120  # Hz: a period is 200 samples
LOUDNESS = 0.3  # peak

VOWEL = 0.110  # seconds at speed 1
CONSONANT = 0.070
PAUSE = 0.150  # after punctuation
EDGE = 0.050  # silence at both ends

_VOWELS = frozenset(symbol for symbol in PHONES if symbol[0] in "AEIOU")

_SPELLED: dict[str, str] = {
    "tch": "CH", "igh": "AY", "ough": "AO",
    "th": "TH", "sh": "SH", "ch": "CH", "ph": "F", "ng": "NG", "ck": "K", "wh": "W", "qu": "K W", "zh": "ZH",
    "gh": "G", "ee": "IY", "ea": "IY", "oo": "UW", "ou": "AW", "ow": "OW", "ai": "EY", "ay": "EY", "oi": "OY",
    "oy": "OY", "au": "AO", "aw": "AO", "er": "ER", "ir": "ER", "ur": "ER", "or": "AO R", "ar": "AA R",
    "a": "AE", "b": "B", "c": "K", "d": "D", "e": "EH", "f": "F", "g": "G", "h": "HH", "i": "IH", "j": "JH", "k": "K",
    "l": "L", "m": "M", "n": "N", "o": "OW", "p": "P", "q": "K", "r": "R", "s": "S", "t": "T", "u": "AH", "v": "V",
    "w": "W", "x": "K S", "y": "IY", "z": "Z",
    "0": "Z IY R OW", "1": "W AH N", "2": "T UW", "3": "TH R IY", "4": "F AO R", "5": "F AY V", "6": "S IH K S",
    "7": "S EH V AH N", "8": "EY T", "9": "N AY N",
    "&": "AE N D", "%": "P ER S EH N T", "@": "AE T", "+": "P L AH S", "=": "IY K W AH L Z", "$": "D AA L ER Z",
    "#": "N AH M B ER",
}  # fmt: skip
_LONGEST = max(map(len, _SPELLED))
_SPOKEN = PHONES[:-1]
_STOPS = frozenset(",.;:!?—…()")


class MockEngine:
    """Speaks instantly. See `app.tts.engine.SpeechEngine`."""

    name = "mock"
    pronounces = True

    def voices(self) -> tuple[Voice, ...]:
        return (Voice("mock", "Buzz", "en", "", RATE, "Apache-2.0", self.name),)

    def warm_up(self) -> None:
        _period("AA")

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        if voice not in ("", "mock"):
            raise NotFound(f"speech engine mock has no voice {voice!r}", field="voice", advice="It has: mock.")
        line = _Line(speed)
        line.rest(EDGE)
        for written in text.split():
            line.word(written, lexicon.get(folded(written)))
        line.rest(EDGE)
        if not line.words:
            raise NothingToSay("the text has nothing to say", field="text")
        samples = np.concatenate([_sound(symbol, start, end) for symbol, start, end in line.spans])
        phones = tuple(Phone(symbol, start / RATE, end / RATE) for symbol, start, end in line.spans)
        return Speech(samples, RATE, phones, tuple(line.words))

    def close(self) -> None:
        """Nothing is held."""


class _Line:
    """Phones one after the other, in samples."""

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self.spans: list[tuple[str, int, int]] = []
        self.words: list[Word] = []
        self.end = 0

    def add(self, symbol: str, seconds: float) -> None:
        start, self.end = self.end, self.end + max(1, round(seconds / self.speed * RATE))
        if symbol == SILENCE and self.spans and self.spans[-1][0] == SILENCE:
            start = self.spans.pop()[1]
        self.spans.append((symbol, start, self.end))

    def rest(self, seconds: float) -> None:
        self.add(SILENCE, seconds)

    def word(self, written: str, said: Pronunciation | None) -> None:
        start = self.end
        phones = spell(written) if said is None else said
        for symbol in phones:
            self.add(symbol, VOWEL if symbol in _VOWELS else CONSONANT)
        if phones:
            self.words.append(Word(written, start / RATE, self.end / RATE))
        if written.rstrip("\"')]}")[-1:] in _STOPS:
            self.rest(PAUSE)


def spell(written: str) -> list[str]:
    """ARPAbet of a written word by a simple table, longest spelling first; any letter or digit has some phone."""
    plain = unicodedata.normalize("NFD", fold(written)).lower()  # accents come off as marks, which have no phone
    letters = re.sub(r"([b-df-hj-np-tv-xz])\1+", r"\1", plain)  # "ll" sounds as "l"
    phones: list[str] = []
    at = 0
    while at < len(letters):
        size = next((n for n in range(_LONGEST, 0, -1) if letters[at : at + n] in _SPELLED), 0)
        if size:
            phones += _SPELLED[letters[at : at + size]].split()
        elif letters[at].isprintable() and not letters[at].isascii() and not unicodedata.combining(letters[at]):
            phones.append(_SPOKEN[ord(letters[at]) % len(_SPOKEN)])
        at += size or 1
    return phones


@cache
def _period(symbol: str) -> NDArray[np.float32]:
    """One period of the buzz of a phone: harmonics of `PITCH` under two resonances, peak `LOUDNESS`, shape (200,)."""
    number = _SPOKEN.index(symbol)
    first, second = 300.0 + 70.0 * (number % 8), 900.0 + 350.0 * (number // 8)  # Hz, different for every phone
    harmonics = np.arange(1, 40)[:, None]
    frequencies = harmonics * PITCH
    gain = 1 / (1 + ((frequencies - first) / 90) ** 2) + 0.5 / (1 + ((frequencies - second) / 150) ** 2)
    wave = (gain * np.cos(2 * np.pi * harmonics * np.arange(RATE // PITCH) * PITCH / RATE)).sum(axis=0)
    period: NDArray[np.float32] = (LOUDNESS * wave / np.abs(wave).max()).astype(np.float32)
    return period


def _sound(symbol: str, start: int, end: int) -> NDArray[np.float32]:
    """Samples `start` to `end` of a phone; the phase runs through from phone to phone."""
    if symbol == SILENCE:
        return np.zeros(end - start, np.float32)
    period = _period(symbol)
    return period[np.arange(start, end) % len(period)]
