"""International phonetic letters, as misaki (hibari), espeak and piper write them, to ARPAbet (`app.speech.PHONES`)."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from app.speech import SILENCE

_IPA: dict[str, tuple[str, ...]] = {
    # two letters that are one sound
    "tʃ": ("CH",), "dʒ": ("JH",), "eɪ": ("EY",), "aɪ": ("AY",), "aʊ": ("AW",), "oʊ": ("OW",), "əʊ": ("OW",),
    "ɔɪ": ("OY",), "ɜɹ": ("ER",), "əɹ": ("ER",), "oɹ": ("AO", "R"), "eə": ("EH", "R"),
    # misaki writes diphthongs, the flap and faint vowels as one letter
    "A": ("EY",), "I": ("AY",), "W": ("AW",), "O": ("OW",), "Q": ("OW",), "Y": ("OY",), "T": ("T",), "S": ("S",),
    "ᵊ": ("AH",), "ᵻ": ("IH",),
    # affricates with a letter of their own
    "ʧ": ("CH",), "ʤ": ("JH",), "ʨ": ("CH",), "ʥ": ("JH",), "ꭧ": ("CH",), "ʦ": ("T", "S"), "ʣ": ("D", "Z"),
    # vowels
    "i": ("IY",), "ɪ": ("IH",), "ɨ": ("IH",), "e": ("EY",), "ɛ": ("EH",), "æ": ("AE",), "a": ("AA",), "ɑ": ("AA",),
    "ɒ": ("AA",), "ɐ": ("AH",), "ə": ("AH",), "ʌ": ("AH",), "ɤ": ("AH",), "ɔ": ("AO",), "o": ("OW",), "ʊ": ("UH",),
    "u": ("UW",), "y": ("UW",), "ɯ": ("UW",), "ɜ": ("ER",), "ɚ": ("ER",), "ɝ": ("ER",), "ø": ("ER",), "œ": ("ER",),
    # stops
    "p": ("P",), "b": ("B",), "t": ("T",), "ʈ": ("T",), "ʔ": ("T",), "d": ("D",), "ɖ": ("D",), "ɾ": ("D",), "ɽ": ("D",),
    "k": ("K",), "c": ("K",), "q": ("K",), "x": ("K",), "ɡ": ("G",), "g": ("G",), "ɣ": ("G",), "ɟ": ("JH",),
    # fricatives
    "f": ("F",), "ɸ": ("F",), "v": ("V",), "β": ("V",), "ʋ": ("V",), "θ": ("TH",), "ð": ("DH",), "s": ("S",),
    "z": ("Z",), "ʃ": ("SH",), "ʂ": ("SH",), "ɕ": ("SH",), "ʒ": ("ZH",), "ʐ": ("ZH",), "ʑ": ("ZH",), "h": ("HH",),
    "ç": ("HH",), "χ": ("HH",), "ħ": ("HH",), "ɦ": ("HH",),
    # nasals, liquids, glides
    "m": ("M",), "ɱ": ("M",), "n": ("N",), "ɳ": ("N",), "ɲ": ("N",), "ŋ": ("NG",), "ɴ": ("NG",), "l": ("L",),
    "ɫ": ("L",), "ɬ": ("L",), "ʎ": ("L",), "ɹ": ("R",), "r": ("R",), "ɻ": ("R",), "ʁ": ("R",), "w": ("W",), "ʍ": ("W",),
    "ɥ": ("W",), "ɰ": ("W",), "j": ("Y",), "ʝ": ("Y",),
}  # fmt: skip

_LONGEST = max(map(len, _IPA))
_STRESS = frozenset("ˈˌ'")
_BREAKS = frozenset('^$_,;:!?.…—–-"()“”«»¿¡|')


@dataclass(frozen=True, slots=True)
class Unit:
    """One symbol as a speech engine times it.

    Attributes:
        symbol: one or more IPA letters and marks, or punctuation, or a space, or nothing (a pause).
        start: seconds.
        end: seconds.
        word: number of the word it belongs to, -1 if none. Letters of different words never merge.
    """

    symbol: str
    start: float
    end: float
    word: int = -1


@dataclass(frozen=True, slots=True)
class Sound:
    """One ARPAbet phone with its times (seconds) and the number of its word (-1: none)."""

    symbol: str
    start: float
    end: float
    word: int = -1


def phones_of(ipa: str) -> tuple[str, ...]:
    """ARPAbet of a string of IPA; stress, length and unknown marks are ignored, spaces and punctuation too."""
    sounds = merge([Unit(letter, float(at), float(at + 1), 0) for at, letter in enumerate(ipa)])
    return tuple(sound.symbol for sound in sounds if sound.symbol != SILENCE)


def unknown(ipa: str) -> str:
    """The first letter or sign of a string of IPA that is none and would be ignored; empty if all are known."""
    for letter in unicodedata.normalize("NFD", ipa):
        if _kind(letter) == "mark" and unicodedata.category(letter)[0] not in "MZ" and letter not in "ːˑʰʲʷˠˤⁿˡ˞ʼ‿͡":
            return letter
    return ""


def merge(units: Iterable[Unit]) -> list[Sound]:
    """Turn timed IPA units into phones of `app.speech.PHONES`.

    A sound written over several units (a diphthong, an affricate) becomes one phone with their joint time. The time of
    a stress mark goes to the phone after it, that of a length mark or an unknown letter to the phone before it.
    Spaces, punctuation and empty units become ``SIL``; neighbouring silences are one.

    Args:
        units: in order of time, each beginning where the one before ended.

    Returns:
        phones in order; gapless if the units were.
    """
    result: list[Sound] = []
    letters: list[Unit] = []
    waiting: float | None = None  # the start of a stress mark whose phone has not come yet
    for unit in units:
        kind = _kind(unit.symbol)
        if kind == "letters":
            start = unit.start if waiting is None else waiting
            waiting = None
            if letters and letters[-1].word != unit.word:
                _flush(letters, result)
            letters += _spread(unit, start)
        elif kind == "stress":
            waiting = unit.start if waiting is None else waiting
        elif kind == "mark" and waiting is None and letters:
            letters[-1] = Unit(letters[-1].symbol, letters[-1].start, unit.end, letters[-1].word)
        else:
            _flush(letters, result)
            start, waiting = (unit.start if waiting is None else waiting), None
            if result and result[-1].symbol == SILENCE:
                result[-1] = Sound(SILENCE, result[-1].start, unit.end)
            else:
                result.append(Sound(SILENCE, start, unit.end))
    _flush(letters, result)
    return result


def _kind(symbol: str) -> str:
    if any(letter in _IPA for letter in symbol):
        return "letters"
    if symbol.strip() and all(letter in _STRESS for letter in symbol):
        return "stress"
    if not symbol.strip() or all(letter in _BREAKS or letter.isspace() for letter in symbol):
        return "break"
    return "mark"


def _spread(unit: Unit, start: float) -> list[Unit]:
    """A unit of several letters as one unit a letter, the time divided evenly."""
    letters = [letter for letter in unicodedata.normalize("NFC", unit.symbol) if letter in _IPA]
    letters = letters or [letter for letter in unit.symbol if letter in _IPA]
    step = (unit.end - start) / len(letters)
    ends = [start + step * (at + 1) for at in range(len(letters) - 1)] + [unit.end]
    return [Unit(a, b, c, unit.word) for a, b, c in zip(letters, [start, *ends], ends, strict=False)]


def _flush(letters: list[Unit], result: list[Sound]) -> None:
    """Append the phones of a run of letters to `result` and empty the run."""
    at = 0
    while at < len(letters):
        size = next(n for n in range(_LONGEST, 0, -1) if _joined(letters[at : at + n], n) in _IPA)
        result += _timed(_IPA[_joined(letters[at : at + size], size)], letters[at : at + size])
        at += size
    letters.clear()


def _joined(letters: Sequence[Unit], size: int) -> str:
    return "".join(unit.symbol for unit in letters) if len(letters) == size else ""


def _timed(phones: tuple[str, ...], letters: Sequence[Unit]) -> list[Sound]:
    word = letters[0].word
    if len(phones) == len(letters):
        return [Sound(phone, unit.start, unit.end, word) for phone, unit in zip(phones, letters, strict=True)]
    start, end = letters[0].start, letters[-1].end
    edges = [start + (end - start) * at / len(phones) for at in range(len(phones))] + [end]
    return [Sound(phone, edges[at], edges[at + 1], word) for at, phone in enumerate(phones)]
