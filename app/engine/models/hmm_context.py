"""Phones between their neighbours, and what decision trees may ask about them (Wang 2010, 2.3 and 3.2)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from app.engine.states import VISEMES, nearest_phone
from app.speech import PHONES, SILENCE, Phone

Labels = NDArray[np.int16]
Flags = NDArray[np.bool_]

COLUMNS = ("last", "this", "next")
"""Of a context: phones as places in `PHONES`."""
THIS = 1
QUIET = PHONES.index(SILENCE)

CLASSES: dict[str, str] = {
    "vowel": "AA AE AH AO AW AY EH ER EY IH IY OW OY UH UW",
    "front vowel": "AE EH EY IH IY", "back vowel": "AA AO OW UH UW", "open vowel": "AA AE AO AW AY",
    "close vowel": "IH IY UH UW", "diphthong": "AW AY EY OW OY", "rounded": "AO OW OY UH UW W SH ZH CH JH R ER",
    "stop": "B D G K P T", "fricative": "DH F HH S SH TH V Z ZH", "affricate": "CH JH", "nasal": "M N NG",
    "glide": "L R W Y", "voiced": "B D DH G JH L M N NG R V W Y Z ZH", "voiceless": "CH F HH K P S SH T TH",
    "lips": "B P M F V W", "tongue tip": "T D N S Z L TH DH", "hissing": "S Z SH ZH CH JH",
    "back consonant": "K G NG HH", "tongue hidden": "P B M F V K G NG HH", "spread": "IY IH EY EH S Z Y",
}  # fmt: skip
"""Of phones that sound or look alike in some way."""


@dataclass(frozen=True)
class Questions:
    """Yes or no about a context.

    Attributes:
        column: (Q,) which of `COLUMNS` is asked about.
        yes: (Q, len(PHONES)) the answer for each phone there.
        names: (Q) in words.
    """

    column: NDArray[np.int64]
    yes: Flags
    names: tuple[str, ...]

    def answers(self, contexts: Labels) -> Flags:
        """(Q, N) for contexts (N, 3)."""
        found: Flags = self.yes[np.arange(len(self.yes))[:, None], contexts.T[self.column]]
        return found


@cache
def questions() -> Questions:
    """Every phone, viseme and class at each place."""
    sets: dict[frozenset[str], str] = {}
    for name, members in CLASSES.items():
        sets.setdefault(frozenset(members.split()), name)
    for viseme in VISEMES:
        sets.setdefault(frozenset(viseme), "looks like " + viseme[0])
    for phone in PHONES:
        sets.setdefault(frozenset([phone]), phone)
    yes = np.array([[phone in members for phone in PHONES] for members in sets])
    return Questions(
        np.repeat(np.arange(len(COLUMNS)), len(sets)), np.tile(yes, (len(COLUMNS), 1)),
        tuple(f"{column}: {name}" for column in COLUMNS for name in sets.values()),
    )  # fmt: skip


def contexts(phones: Sequence[Phone], trained: Collection[str]) -> Labels:
    """Contexts (N, 3) of phones; those that were not trained are taken for what looks like them most.

    Outside there is silence.
    """
    stand_in = {symbol: PHONES.index(nearest_phone(symbol, trained)) for symbol in {each.symbol for each in phones}}
    padded = np.array([QUIET, *(stand_in[each.symbol] for each in phones), QUIET])
    return np.stack([padded[at : at + len(phones)] for at in range(len(COLUMNS))], axis=1).astype(np.int16)
