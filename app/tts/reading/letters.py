"""What is read letter by letter, and which words in capitals are words.

Letters are handed to engines as ``F.B.I``: hibari, espeak and the dictionary read this letter by letter, with the
stress on the last one; letters with spaces between them would make an article of A.
"""

from __future__ import annotations

import re

from app.tts.reading.word_list import these

_SAID_AS_WORDS = these(
    "AIDS ASAP COVID EBITDA FEMA FIFA FIFO GIF GIFS HIPAA IKEA JPEG LASER LIDAR LIFO MIDI NAFTA NASA NASDAQ NATO NOAA "
    "OPEC OSHA PIN PINS RADAR RAM REST ROM SCSI SCUBA SIM SONAR SPAM SWAT TEFL UNESCO UNICEF WASP WYSIWYG YOLO ZIP "
    "BASIC DOS IMAX LEGO MAC MAX NIMBY SARS TED VISA WIFI GNU YAML TOML JSON BIOS CAD CAPTCHA"
)
_SAID_AS_LETTERS = these(
    "AC AD AI AM API AR ATM BA BC CD CEO CO DC DIY DJ EPA EU EV FAQ GOP ID IM IO IP IQ IRS IT LA LED LOL MA MI MS NO "
    "OS PA PE PM PS RIP SAT SIS SO SOS TA TV UFO UI UK UN UP URL US USA USB UX VIP VR WHO"
) - {"NO", "SO", "UP", "LOL"}
_CAPITALS = re.compile(r"[A-Z]{2,}\Z")
_WITH_SUFFIX = re.compile(r"([A-Z]{2,})('?s)\Z")
_MIXED = re.compile(r"([a-z])([A-Z]{2,})\Z")
_VOWELS = frozenset("AEIOUYaeiouy")


def spelled(letters: str) -> str:
    """Letters one by one: ``FBI`` as ``F.B.I``. Of the letters A to Z, any case."""
    return ".".join(letters.upper())


def spelled_plural(letters: str) -> str:
    """Letters with a plural or possessive S: ``CD`` as ``C D's``, which sounds as "see dees"."""
    head, last = letters[:-1].upper(), letters[-1].upper()
    if head == "A":
        return f"A-{last}'s"
    return f"{spelled(head)} {last}'s" if head else f"{last}'s"


def initials(word: str, *, shouted: bool = False, known: bool = False) -> str:
    """A word in capitals as letters; empty if it is to be said as a word.

    Args:
        word: without punctuation round it.
        shouted: the text around is in capitals as well, so capitals say nothing.
        known: a dictionary has it as a word.
    """
    if suffixed := _WITH_SUFFIX.match(word):
        letters = suffixed[1]
        if letters in _SAID_AS_WORDS or (shouted and known) or _is_word(letters, shouted, known):
            return ""
        return spelled_plural(letters)
    if mixed := _MIXED.match(word):  # mRNA, eID
        return f"{mixed[1].upper()} {spelled(mixed[2])}"
    if word == "PhD":
        return "P.H.D"
    if not _CAPITALS.match(word) or _is_word(word, shouted, known):
        return ""
    return spelled(word)


def _is_word(word: str, shouted: bool, known: bool) -> bool:
    if word in _SAID_AS_WORDS:
        return True
    if word in _SAID_AS_LETTERS and not (shouted and known):
        return False
    if known and (shouted or len(word) > 2) and _VOWELS & set(word):
        return True
    return len(word) > 5 and bool(_VOWELS & set(word))


def sayable(word: str) -> bool:
    """Whether a word in small letters, of a URL say, can be said at all; ``bbc`` cannot."""
    return bool(_VOWELS & set(word))
