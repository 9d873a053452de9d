"""Where in a known text somebody is, told by the phones that were heard so far.

What is heard is wrong now and then; the text is right, if it is what is said. So what was heard last is laid beside the
text that is due, with the fewest and smallest corrections, and takes the text's phones. It is followed as it is spoken:
a phone that has been shown is not changed any more, but it still counts when the next ones are laid beside the text.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.align.dictionary import WrittenWord

MEMORY = 10  # phones that were shown and still count
AHEAD = 8  # phones of the text beyond what was heard that are looked at
FAR = 60  # phones of the text among which somebody who is lost is looked for
MISSING = 0.7  # cost of a phone of the text that was not heard, and of one heard that is not in the text
LOST = 0.45  # mean cost of the phones remembered at which the text is not what is said: right texts reach 0.40
FOUND = 0.25  # mean cost at which it is again
FEWEST = 5  # phones remembered before that is judged
ENOUGH = 8  # phones that have to fit before it is found again: five fit somewhere by chance
MOST_SKIPPED = 3  # phones of the text that a single phone heard may stand for; more were left out

_VOWELS = frozenset(["AA", "AE", "AH", "AO", "AW", "AY", "EH", "ER", "EY", "IH", "IY", "OW", "OY", "UH", "UW"])
_ALIKE = (
    ("P", "B", "M"), ("F", "V", "TH", "DH"), ("T", "D", "N", "DH"), ("S", "Z", "SH", "ZH"), ("K", "G", "NG"),
    ("CH", "JH", "SH", "ZH", "T", "D"), ("R", "ER", "W"), ("L", "W"), ("W", "UW", "UH"), ("Y", "IY", "IH"),
    ("N", "NG", "M"),
    ("AA", "AO", "AH"), ("AE", "EH", "AH"), ("EH", "EY", "IH"), ("IH", "IY", "AH"), ("OW", "AO", "UH"), ("AY", "AA"),
    ("AW", "AA"), ("AH", "ER", "UH"), ("UW", "UH", "OW"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Place:
    """What a phone that was heard is in the text.

    Attributes:
        numbers: of the text's phones that it stands for, in order; none if it is not in the text.
    """

    numbers: tuple[int, ...] = ()


class Follower:
    """Follows a text.

    Args:
        words: the text; the first pronunciation of each word counts.

    Attributes:
        symbols: the phones of the text.
        owners: number of the word that each of them belongs to.
        lost: what is heard is not the text, at present.
    """

    def __init__(self, words: Sequence[WrittenWord]) -> None:
        said = [(phone, number) for number, word in enumerate(words) for phone in (*word.pronunciations, ())[0]]
        self.symbols = [phone for phone, _ in said]
        self.owners = [number for _, number in said]
        self.lost = False
        self._next = 0  # the phone of the text that is due
        self._past: deque[tuple[str, int, float]] = deque(maxlen=MEMORY)  # heard, due before it, cost

    def follow(self, heard: Sequence[str], settled: int) -> list[Place]:
        """The places of phones that were heard.

        Args:
            heard: what follows the phones settled before, in order.
            settled: how many of them are shown now; the others come again in the next call.

        Returns:
            a place for each of `heard`.
        """
        if not self.symbols:
            return [Place()] * len(heard)
        if self.lost:
            self._look_for(heard)
        past = list(self._past)
        origin = past[0][1] if past and not self.lost else self._next
        before = [symbol for symbol, _, _ in past] if not self.lost else []
        text = self.symbols[origin : self._next + 2 * len(heard) + AHEAD]
        places, costs = _laid([*before, *heard], text, origin)
        places, costs = places[len(before) :], costs[len(before) :]
        result: list[Place] = []
        due = self._next
        for number, (symbol, place, cost) in enumerate(zip(heard, places, costs, strict=True)):
            numbers = tuple(each for each in place if each >= due)[-MOST_SKIPPED:]
            if number < settled:
                self._past.append((symbol, due, cost))
                self._next = numbers[-1] + 1 if numbers and not self.lost else self._next
            due = numbers[-1] + 1 if numbers else due
            result.append(Place() if self.lost else Place(numbers))
        if len(self._past) >= FEWEST:
            self.lost = float(np.mean([cost for _, _, cost in self._past])) > LOST
        return result

    def _look_for(self, heard: Sequence[str]) -> None:
        """Find the text again where what was heard last fits well."""
        last = [*(symbol for symbol, _, _ in self._past), *heard][-MEMORY:]
        if len(last) < ENOUGH or self._next >= len(self.symbols):
            return
        origin = max(0, self._next - MEMORY)
        table = _table(last, self.symbols[origin : self._next + FAR], anywhere=True)
        end = int(np.argmin(table[-1]))
        if table[-1, end] / len(last) > FOUND:
            return
        self.lost = False
        self._past.clear()
        self._next = max(0, origin + end - len(heard))


def _laid(heard: Sequence[str], text: Sequence[str], origin: int) -> tuple[list[tuple[int, ...]], list[float]]:
    """For each phone heard the numbers of the text's phones that it stands for, and what that costs."""
    table = _table(heard, text, anywhere=False)
    column = int(np.argmin(table[-1]))
    places: list[tuple[int, ...]] = [()] * len(heard)
    costs = [0.0] * len(heard)
    row = len(heard)
    skipped: list[int] = []
    owner = -1  # the phone heard that those skipped before it are given to
    while row > 0:
        if column > 0 and table[row, column] == table[row - 1, column - 1] + _cost(heard[row - 1], text[column - 1]):
            if owner >= 0:
                places[owner] = (*reversed(skipped), *places[owner])
            skipped, owner = [], row - 1
            places[owner] = (origin + column - 1,)
            costs[owner] += _cost(heard[row - 1], text[column - 1])
            row, column = row - 1, column - 1
        elif table[row, column] == table[row - 1, column] + MISSING:
            costs[row - 1] += MISSING
            row -= 1
        else:
            column -= 1
            skipped.append(origin + column)
            if owner >= 0:
                costs[owner] += MISSING
    if owner >= 0:
        skipped += [origin + each for each in reversed(range(column))]
        places[owner] = (*reversed(skipped), *places[owner])
    return places, costs


def _table(heard: Sequence[str], text: Sequence[str], *, anywhere: bool) -> NDArray[np.float64]:
    """Least costs of laying the first phones heard beside the first of the text, shape (heard + 1, text + 1).

    Args:
        heard, text: the phones.
        anywhere: it may begin anywhere in the text at no cost.
    """
    table = np.zeros((len(heard) + 1, len(text) + 1))
    table[0] = 0.0 if anywhere else np.arange(len(text) + 1) * MISSING
    for row, symbol in enumerate(heard, 1):
        table[row, 0] = row * MISSING
        for column, due in enumerate(text, 1):
            table[row, column] = min(
                table[row - 1, column - 1] + _cost(symbol, due),
                table[row - 1, column] + MISSING,
                table[row, column - 1] + MISSING,
            )
    return table


def _cost(one: str, other: str) -> float:
    if one == other:
        return 0.0
    if frozenset((one, other)) in _PAIRS:
        return 0.3
    if one in _VOWELS and other in _VOWELS:
        return 0.5
    return 0.9 if (one in _VOWELS) == (other in _VOWELS) else 1.3


_PAIRS = frozenset(frozenset((one, other)) for group in _ALIKE for one in group for other in group if one != other)
