"""Dates, years and times of the day, one written word each."""

from __future__ import annotations

import re

from app.tts.reading.numbers import cardinal, digits, ordinal, plural, year

NAMES = (
    "January", "February", "March", "April", "May", "June", "July", "August", "September", "October", "November",
    "December",
)  # fmt: skip
MONTHS: dict[str, str] = {short: name for name in NAMES for short in (name.lower(), name[:3].lower())}
MONTHS["sept"] = "September"
WEEKDAYS: dict[str, str] = {
    "mon": "Monday", "tue": "Tuesday", "tues": "Tuesday", "wed": "Wednesday", "thu": "Thursday", "thur": "Thursday",
    "thurs": "Thursday", "fri": "Friday", "sat": "Saturday", "sun": "Sunday",
}  # fmt: skip
_ISO = re.compile(r"([0-9]{4})([-/])([0-9]{1,2})\2([0-9]{1,2})\Z")
_NUMERIC = re.compile(r"([0-9]{1,2})([-/.])([0-9]{1,2})\2([0-9]{4}|[0-9]{2})\Z")
_TIMESTAMP = re.compile(
    r"([0-9]{4}-[0-9]{2}-[0-9]{2})T([0-9]{2}:[0-9]{2}(?::[0-9]{2})?)(?:\.[0-9]+)?(?:Z|[+-][0-9:]+)?\Z"
)
_TIME = re.compile(r"([0-9]{1,2}):([0-9]{2})(?::([0-9]{2}))?(am|pm|a\.m\.?|p\.m\.?)?\Z", re.IGNORECASE)
_HOUR = re.compile(r"([0-9]{1,2})(am|pm|a\.m\.?|p\.m\.?)\Z", re.IGNORECASE)
_HALF = re.compile(r"(?:am|pm|a\.m\.?|p\.m\.?)\Z", re.IGNORECASE)
_DECADE = re.compile(r"'?([0-9]{4}|[0-9]0)'?s\Z")
_DAY = re.compile(r"([0-9]{1,2})(?:st|nd|rd|th)?\Z", re.IGNORECASE)
_YEAR = re.compile(r"(?:1[0-9]|20)[0-9]{2}\Z")


def day(text: str) -> int:
    """The day of a month, ``5`` or ``5th``; 0 if it is none."""
    found = _DAY.match(text)
    return int(found[1]) if found and 1 <= int(found[1]) <= 31 else 0


def is_year(text: str) -> bool:
    """Whether four digits look like a year from 1000 to 2099."""
    return _YEAR.match(text) is not None


def date(text: str) -> str:
    """A date in figures: ``2026-11-24``, ``2026/11/24``, ``24.11.2026``, ``11/24/2026``, ``11-24-2026``.

    Without points, the month is first, unless it is over 12.

    Returns:
        ``November twenty fourth, twenty twenty six``; empty if it is no date.
    """
    if found := _TIMESTAMP.match(text):
        on, at = date(found[1]), time(found[2])
        return f"{on}, {at}" if on and at else ""
    if found := _ISO.match(text):
        return _date(int(found[1]), int(found[3]), int(found[4]))
    if not (found := _NUMERIC.match(text)):
        return ""
    first, second, of = int(found[1]), int(found[3]), int(found[4])
    if len(found[4]) == 2:
        if found[2] != "/":  # 1.2.10 is a version, 1-2-10 a score
            return ""
        of += 1900 if of > 50 else 2000
    if found[2] == "." or first > 12:
        first, second = second, first
    return _date(of, first, second)


def _date(of: int, month: int, on: int) -> str:
    if not (1 <= month <= 12 and 1 <= on <= 31):
        return ""
    return f"{NAMES[month - 1]} {ordinal(on)}, {year(of)}"


def decade(text: str) -> str:
    """``1990s`` as ``nineteen nineties``, ``'80s`` as ``eighties``; empty if it is none."""
    found = _DECADE.match(text)
    if not found:
        return ""
    first, _, last = (year(int(found[1])) if len(found[1]) == 4 else cardinal(int(found[1]))).rpartition(" ")
    return f"{first} {plural(last)}".lstrip()


def half_of_day(text: str) -> str:
    """``pm``, ``P.M.`` as ``P.M``; empty if it is neither half."""
    return f"{text[0].upper()}.M" if _HALF.match(text) else ""


def time(text: str, *, half: bool = False) -> str:
    """A time of the day: ``10:30pm``, ``14:05``, ``7:00``, ``10:30:15``, ``7pm``; empty if it is none.

    Args:
        half: "am" or "pm" follows as a word of its own, so a full hour is said without "o'clock".
    """
    if found := _HOUR.match(text):
        return f"{cardinal(int(found[1]))} {half_of_day(found[2])}" if 0 < int(found[1]) <= 12 else ""
    found = _TIME.match(text)
    if not found:
        return ""
    hour, minute, second = int(found[1]), int(found[2]), int(found[3] or 0)
    if hour > 24 or minute > 59 or second > 59:
        return ""
    said = cardinal(hour)
    if minute:
        said += f" oh {cardinal(minute)}" if minute < 10 else f" {cardinal(minute)}"
    elif hour > 12 or hour == 0:
        said += " hundred"
    elif not (found[4] or found[3] or half):
        said += " o'clock"
    if found[3]:
        said += f" and {cardinal(second)} second{'' if second == 1 else 's'}"
    return f"{said} {half_of_day(found[4])}" if found[4] else said


def telephone(text: str) -> str:
    """The digits of a telephone number one by one, with a comma between its groups."""
    groups = [group for group in re.split(r"[^0-9]+", text) if group]
    said = ", ".join(digits(group) for group in groups)
    return f"plus {said}" if text.lstrip("( ").startswith("+") and said else said
