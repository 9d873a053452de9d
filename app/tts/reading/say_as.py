"""SSML's ``say-as``: a text read as the kind of thing that its writer says it is."""

from __future__ import annotations

import re
from collections.abc import Callable

from app.tts.reading import amounts, dates
from app.tts.reading.addresses import NAMES
from app.tts.reading.letters import spelled
from app.tts.reading.numbers import MOST_DIGITS, PLAIN, cardinal, digits, fraction, number, ordinal, roman, year
from app.tts.reading.word_list import these

_NUMBER = re.compile(rf"([-+]?)\s*({PLAIN})\Z")
_WHOLE = re.compile(r"([0-9][0-9,]*)(?:st|nd|rd|th)?\Z", re.IGNORECASE)
_MIXED = re.compile(r"([0-9]{1,9})\s*[\s+]\s*([0-9]{1,4})\s*/\s*([0-9]{1,4})\Z")
_SIMPLE = re.compile(r"(-?)([0-9]{1,9})\s*/\s*([0-9]{1,9})\Z")
_AMOUNT = re.compile(r"([-+]?[0-9.,]+)\s*(\S+)\Z")
_SEPARATORS = re.compile(r"[\s/.,-]+")
_FORMATS = these("mdy dmy ymd ydm md dm ym my d m y")
_PUNCTUATION = {",": "comma", ";": "semicolon", "'": "apostrophe", '"': "quote", "(": "open parenthesis",
                ")": "close parenthesis", "<": "less than", ">": "greater than", "|": "bar"}  # fmt: skip


def say_as(text: str, kind: str, form: str = "") -> str:
    """A text read as `kind`; empty if it cannot be read so.

    Args:
        text: without space at its ends.
        kind: one of `KINDS`.
        form: of a date: its parts in order, as ``mdy``; else ignored.
    """
    return _date(text, form) if kind == "date" else KINDS[kind](text)


def _characters(text: str) -> str:
    said: list[str] = []
    for run in re.findall(r"[A-Za-z]+|.", text, re.DOTALL):
        if run.isascii() and run.isalpha():
            said.append(spelled(run))
        elif run.isalpha():
            said.append(run)
        elif "0" <= run <= "9":
            said.append(digits(run))
        else:
            said.append(NAMES.get(run) or _PUNCTUATION.get(run, ""))
    return " ".join(filter(None, said))


def _cardinal(text: str) -> str:
    if found := _NUMBER.match(text):
        return amounts.sign(found[1]) + number(found[2])
    return cardinal(roman(text)) if roman(text) else ""


def _ordinal(text: str) -> str:
    found = _WHOLE.match(text)
    value = found[1].replace(",", "") if found else ""
    if value and len(value) <= MOST_DIGITS:
        return ordinal(int(value))
    return ordinal(roman(text)) if roman(text) else ""


def _date(text: str, form: str) -> str:
    if not form:
        return dates.date(text)
    parts = [part for part in _SEPARATORS.split(text) if part]
    if form == "ymd" and len(parts) == 1 and len(text) == 8:
        parts = [text[:4], text[4:6], text[6:]]
    if form not in _FORMATS or len(parts) != len(form):
        return ""
    said: dict[str, str] = {}
    for part, letter in zip(parts, form, strict=True):
        said[letter] = _DATE_PARTS[letter](part)
    if not all(said.values()):
        return ""
    if "m" not in said:
        return " ".join(said.values())
    day_and_month = said["m"] + (f" {said['d']}" if "d" in said else "")
    return day_and_month + (f"{',' if 'd' in said else ''} {said['y']}" if "y" in said else "")


def _day(text: str) -> str:
    return ordinal(dates.day(text)) if dates.day(text) else ""


def _month(text: str) -> str:
    if text.isascii() and text.isdecimal() and 1 <= int(text[:3]) <= 12:
        return dates.NAMES[int(text[:3]) - 1]
    return dates.MONTHS.get(text.lower(), "")


def _year(text: str) -> str:
    if not (text.isascii() and text.isdecimal()):
        return ""
    return year(int(text)) if len(text) == 4 else cardinal(int(text)) if len(text) < 4 else ""


_DATE_PARTS: dict[str, Callable[[str], str]] = {"d": _day, "m": _month, "y": _year}


def _time(text: str) -> str:
    return dates.time(re.sub(r"\s+(?=[ap])", "", text, flags=re.IGNORECASE))


def _fraction(text: str) -> str:
    if (found := _MIXED.match(text)) and (part := _over(int(found[2]), int(found[3]))):
        return f"{number(found[1])} and {part.replace('one ', 'a ', 1)}"
    if found := _SIMPLE.match(text):
        said = _over(int(found[2]), int(found[3]))
        return amounts.sign(found[1]) + said if said else ""
    return amounts.vulgar(text)


def _over(above: int, below: int) -> str:
    if below < 2:
        return ""
    return fraction(above, below) if below <= 100 else f"{cardinal(above)} over {cardinal(below)}"


def _unit(text: str) -> str:
    found = _AMOUNT.match(text)
    return (amounts.amount(found[1] + found[2]) or amounts.vulgar(text)) if found else amounts.unit(text, single=True)


KINDS: dict[str, Callable[[str], str]] = {
    "characters": _characters, "spell-out": _characters, "verbatim": _characters, "cardinal": _cardinal,
    "number": _cardinal, "ordinal": _ordinal, "digits": digits, "date": dates.date, "time": _time,
    "telephone": dates.telephone, "fraction": _fraction, "unit": _unit,
}  # fmt: skip
"""What ``interpret-as`` may be."""
