"""How written words are pronounced: a caller's lexicon, then the CMU dictionary, then letter-to-sound."""

from __future__ import annotations

import re
import threading
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any

from app.align.phoneset import phones_of
from app.align.spelling import spell
from app.errors import InputError, MissingExtra
from app.speech import PHONES, SILENCE

Pronunciation = tuple[str, ...]

Lexicon = Mapping[str, Pronunciation]
"""Words as `folded` has them, and how they are said: ARPAbet without stress. `read_lexicon` makes one."""

NO_LEXICON: Lexicon = MappingProxyType({})

MOST_PRONUNCIATIONS = 8  # of one written word: "well-read" multiplies those of its parts
MOST_LETTERS = 60  # a longer "word" (a URL, a key mash) is read up to here
_SPOKEN = frozenset(PHONES) - {SILENCE}
_QUOTES = str.maketrans({"’": "'", "‘": "'", "ʼ": "'", "`": "'", "´": "'", "‐": "-", "‑": "-", "–": "-", "—": "-"})
_EDGE = re.compile(
    r"^[^\w$£€#@&%+=°']+|[^\w%&+=°']+$", re.UNICODE
)  # punctuation around a word; signs that are read stay
_PARTS = re.compile(r"[-/_]+|(?<=[^\W\d])\.(?=[^\W\d])")
_DIGIT = re.compile(r"\d")
_LONG_NUMBER = re.compile(r"\d(?:[,.]?\d){15,}")  # read digit by digit: number words end somewhere
_AMOUNT = re.compile(r"([$£€])(\d[\d.,]*)$")
_CURRENCIES = {"$": "dollars", "£": "pounds", "€": "euros"}
_MAGNITUDES = frozenset(["hundred", "thousand", "million", "billion", "trillion"])
_KEPT = frozenset("²³½¼¾™®°")  # compatibility would make other numbers and words of them
_VOICELESS = frozenset(["P", "T", "K", "F", "TH"])
_HISSING = frozenset(["S", "Z", "SH", "ZH", "CH", "JH"])


@dataclass(frozen=True, slots=True)
class WrittenWord:
    """A word of a text and how it may be said.

    Attributes:
        text: as it is written, punctuation included.
        pronunciations: alternatives, each of ARPAbet phones without stress; none if the word has no sound.
        guessed: no dictionary has it: letter-to-sound, or a number that could be read in several ways.
    """

    text: str
    pronunciations: tuple[Pronunciation, ...]
    guessed: bool = False


class Dictionary:
    """Pronounces texts. May be used from several threads.

    Args:
        lexicon: pronunciations of one's own, looked at first: word (any case) to ARPAbet, as ``"N UW Y EH N"`` or a
            sequence of phones; stress digits are ignored.

    Raises:
        InputError: a pronunciation in the lexicon has a phone that is none.
    """

    def __init__(self, lexicon: Mapping[str, str | Sequence[str]] | None = None) -> None:
        self._own = {word: (said,) for word, said in read_lexicon(lexicon or {}).items()}

    def with_lexicon(self, lexicon: Lexicon) -> Dictionary:
        """The same dictionary with further pronunciations, which come first; words are casefolded as in `folded`."""
        if not lexicon:
            return self
        further = Dictionary()
        further._own = {**self._own, **{word: (said,) for word, said in lexicon.items()}}
        return further

    def read(self, text: str) -> tuple[WrittenWord, ...]:
        """The words of a text, divided at white space, with their pronunciations."""
        words = text.split()
        result: list[WrittenWord] = []
        currency = ""
        for number, written in enumerate(words):
            amount = _AMOUNT.match(written)
            if amount and number + 1 < len(words) and folded(words[number + 1]) in _MAGNITUDES:
                currency = _CURRENCIES[amount[1]]  # said after the next word: $3 million
                result.append(replace(self.word(amount[2]), text=written))
            elif currency:
                result.append(replace(self.word(f"{folded(written)}-{currency}"), text=written))
                currency = ""
            else:
                result.append(self.word(written))
        return tuple(result)

    def word(self, written: str) -> WrittenWord:
        """One written word with its pronunciations."""
        plain = folded(written)
        known = self._known(plain)
        if known:
            return WrittenWord(written, known)
        parts = [part for part in _PARTS.split(plain) if part.strip("'")]
        if _DIGIT.search(plain) or not parts:
            said = _letter_to_sound(plain)
            return WrittenWord(written, (said,) if said else (), bool(said))
        choices: list[tuple[Pronunciation, ...]] = []
        guessed = False
        for part in parts:
            known = self._known(part)
            if not known and (said := _letter_to_sound(_original(written, part))):
                known, guessed = (said,), True
            if known:
                choices.append(known)
        if not choices:
            return WrittenWord(written, ())
        joined = dict.fromkeys(tuple(phone for said in each for phone in said) for each in product(*choices[:12]))
        return WrittenWord(written, tuple(joined)[:MOST_PRONUNCIATIONS], guessed)

    def knows(self, written: str) -> bool:
        """Whether the lexicon or the CMU dictionary has the word, or all parts of it; a word without letters counts."""
        plain = folded(written)
        return bool(self._known(plain)) or all(
            self._known(part) for part in _PARTS.split(plain) if any(map(str.isalpha, part))
        )

    def _known(self, word: str) -> tuple[Pronunciation, ...]:
        """What the lexicon or the CMU dictionary says, possessives included; nothing if neither knows the word."""
        entries = _cmudict()
        for form in (word, word.strip("'")):
            if form in self._own:
                return self._own[form]
            if form in entries:
                return tuple(tuple(said.split()) for said in entries[form])
        if word.endswith("'s") and (stem := self._known(word[:-2])):
            return tuple((*said, *_ending(said[-1])) for said in stem)
        return ()


def read_lexicon(lexicon: Mapping[str, str | Sequence[str]]) -> Lexicon:
    """A lexicon as people write it, checked: word (as in `folded`) to ARPAbet without stress.

    Args:
        lexicon: word, in any case, to phones as ``"N UW Y EH N"`` or a sequence; stress digits are ignored.

    Raises:
        InputError: a pronunciation has a phone that is none, or a word that is none.
    """
    return {_word_of(word): _phones(word, said) for word, said in lexicon.items()}


def _word_of(word: str) -> str:
    if len(word.split()) != 1 or not folded(word):
        raise InputError(
            f"lexicon: {word!r} is not one word", field="lexicon", advice="Give a pronunciation to each word by itself."
        )
    return folded(word)


def folded(written: str) -> str:
    """A written word as dictionaries have it: lower case, plain quotes, without the punctuation around it."""
    kept = written.translate(_QUOTES)[:MOST_LETTERS]
    plain = "".join(letter if letter in _KEPT else unicodedata.normalize("NFKC", letter) for letter in kept)
    return _EDGE.sub("", unicodedata.normalize("NFC", plain)).lower()


def _original(written: str, part: str) -> str:
    """The part as it was written: capitals tell letter-to-sound what is an abbreviation."""
    at = written.lower().find(part)
    return written[at : at + len(part)] if at >= 0 else part


def _ending(last: str) -> Pronunciation:
    if last in _HISSING:
        return ("IH", "Z")
    return ("S",) if last in _VOICELESS else ("Z",)


def _phones(word: str, said: str | Sequence[str]) -> Pronunciation:
    phones = tuple(phone.upper().rstrip("012") for phone in (said.split() if isinstance(said, str) else said))
    if wrong := [phone for phone in phones if phone not in _SPOKEN]:
        raise InputError(
            f"lexicon: {word!r} is pronounced with {wrong[0]!r}, which is no phone",
            advice=f"Phones are {' '.join(sorted(_SPOKEN))}.",
            field="lexicon",
        )
    if not phones:
        raise InputError(f"lexicon: {word!r} has no phones", field="lexicon")
    return phones


@cache
def _cmudict() -> dict[str, tuple[str, ...]]:
    """The CMU dictionary of pocketsphinx: word to its pronunciations. 0.2 s and 30 MB, once."""
    package = find_spec("pocketsphinx")
    if package is None or not package.submodule_search_locations:
        raise MissingExtra("the dictionary comes with pocketsphinx, which is not installed", advice="make install")
    path = Path(package.submodule_search_locations[0]) / "model" / "en-us" / "cmudict-en-us.dict"
    entries: dict[str, tuple[str, ...]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        word, _, said = line.partition(" ")
        if word.endswith(")"):
            word = word[: word.index("(", 1)]
        entries[word] = (*entries.get(word, ()), said)
    return entries


# --- letter-to-sound --------------------------------------------------------------------------------------------------

_lock = threading.Lock()  # nothing promises that hibari's reader may be used from several threads


def _letter_to_sound(word: str) -> Pronunciation:
    """Phones of any word, number or sign; none if it has no sound."""
    word = _LONG_NUMBER.sub(lambda number: " ".join(filter(str.isdigit, number[0])), word)
    reader = _reader()
    if reader is not None and _latin(word):
        with _lock:
            try:
                said = phones_of(reader(word))
            except Exception:  # it is young: whatever it stumbles over is spelled
                said = ()
        if said:
            return said
    return spell(word)


def _latin(word: str) -> bool:
    return all(ord(letter) < 0x250 or unicodedata.category(letter)[0] != "L" for letter in word)


@cache
def _reader() -> Any:
    """Hibari's letter-to-sound; None if the voice is not installed."""
    try:
        from hibari.g2p import G2P
    except ImportError:
        return None
    return G2P(british=False)
