"""From one thing to another of its kind, in one written word: ordinals, dates, times, amounts."""

from __future__ import annotations

import re

from app.tts.reading import amounts, dates
from app.tts.reading.numbers import PLAIN, cardinal, ordinal

_RANGE = re.compile(r"([^—-]+)[—-]([^—-]+)\Z")
_ORDINAL = re.compile(r"([0-9]{1,15})(?:st|nd|rd|th)\Z", re.IGNORECASE)
_HOUR = re.compile(r"(?:[1-9]|1[0-2])\Z")
_MEASURED = re.compile(rf"([+±~]?{PLAIN})(\D+)\Z")


def between(text: str) -> str:
    """``2nd-3rd``, ``10am-5pm``, ``9-5pm``, ``20%-30%``, ``5cm-1m`` with "to"; empty if it is no such range."""
    found = _RANGE.match(text)
    if not found:
        return ""
    low, high = found.groups()
    if until := dates.time(high):
        halved = dates.half_of_day(high.lstrip("0123456789:"))
        since = cardinal(int(low)) if halved and _HOUR.match(low) else dates.time(low, half=bool(halved))
        return f"{since} to {until}" if since else ""
    for reading in (_nth, dates.date, dates.decade):
        if (since := reading(low)) and (until := reading(high)):
            return f"{since} to {until}"
    first, last = _MEASURED.match(low), _MEASURED.match(high)
    if first and last and first[2] == last[2] and (said := amounts.amount(f"{first[1]}-{high}")):
        return said
    since, until = amounts.amount(low), amounts.amount(high)
    return f"{since} to {until}" if since and until else ""


def _nth(text: str) -> str:
    return ordinal(int(found[1])) if (found := _ORDINAL.match(text)) else ""
