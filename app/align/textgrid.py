"""Reads Praat's TextGrid files, as the Montreal Forced Aligner and others write them, in the long and the short form.

Praat's own reader takes free-standing numbers, quoted texts and flags and ignores everything else, which makes the two
forms one; so does this.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from app.errors import InputError

_TOKEN = re.compile(
    r'"(?P<text>(?:[^"]|"")*)"'
    r"|<(?P<flag>\w+)>"
    r"|(?<!\S)(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?!\S)"
    r"|(?<!\S)!.*"  # a comment
)
MOST_INTERVALS = 1_000_000


@dataclass(frozen=True, slots=True)
class Interval:
    """A label and the time it holds, in seconds."""

    start: float
    end: float
    label: str


@dataclass(frozen=True, slots=True)
class Tier:
    """One row of intervals, in order of time. Point tiers are not read."""

    name: str
    intervals: tuple[Interval, ...]


def parse(text: str) -> tuple[Tier, ...]:
    """The interval tiers of a TextGrid.

    Raises:
        InputError: it is no TextGrid, is cut off, or its times go backwards.
    """
    tokens = _Tokens(text)
    kind, content = tokens.text(), tokens.text()
    if kind not in ("ooTextFile", "Praat chronological TextGrid text file") or content != "TextGrid":
        raise InputError('TextGrid: the file does not begin with "ooTextFile" and "TextGrid"')
    tokens.number(), tokens.number()
    if not tokens.flag():
        return ()
    tiers: list[Tier] = []
    for _ in range(tokens.count()):
        kind, name = tokens.text(), tokens.text()
        tokens.number(), tokens.number()
        count = tokens.count()
        if kind == "IntervalTier":
            tiers.append(Tier(name, _intervals(tokens, name, count)))
        elif kind == "TextTier":
            for _ in range(count):
                tokens.number(), tokens.text()
        else:
            raise InputError(f"TextGrid: unknown kind of tier {kind!r}")
    return tuple(tiers)


def _intervals(tokens: _Tokens, name: str, count: int) -> tuple[Interval, ...]:
    intervals: list[Interval] = []
    at = float("-inf")
    for _ in range(count):
        interval = Interval(tokens.number(), tokens.number(), tokens.text().strip())
        if interval.start < at - 1e-6 or interval.end < interval.start:
            raise InputError(f"TextGrid: the times of tier {name!r} go backwards at {interval.start:g} s")
        at = interval.end
        intervals.append(interval)
    return tuple(intervals)


class _Tokens:
    """What counts in the file, one after the other, each of the kind that is expected."""

    def __init__(self, text: str) -> None:
        self._matches = _TOKEN.finditer(text)

    def text(self) -> str:
        return self._next("text").replace('""', '"')

    def number(self) -> float:
        return float(self._next("number"))

    def flag(self) -> bool:
        return self._next("flag") == "exists"

    def count(self) -> int:
        number = self.number()
        if not 0 <= number <= MOST_INTERVALS or number != int(number):
            raise InputError(f"TextGrid: {number:g} is no number of tiers or intervals")
        return int(number)

    def _next(self, kind: str) -> str:
        for match in self._matches:
            if match.lastgroup is not None:
                if match.lastgroup != kind:
                    raise InputError(f"TextGrid: a {kind} was expected, {match[0][:40]!r} found")
                return match[match.lastgroup]
        raise InputError(f"TextGrid: the file ends where a {kind} was expected")
