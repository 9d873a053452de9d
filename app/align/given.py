"""Sound that is given together with its phone times: read, checked, and made gapless."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

from app.align.sound_file import read_sound
from app.errors import InputError
from app.speech import PHONES, SILENCE, Phone, Speech

TOLERANCE_SECONDS = 0.05
"""How much longer than the sound given phone times may be; programs round differently."""

SMALLEST_GAP_SECONDS = 0.001
"""A shorter gap between two phones is rounding, a longer one is silence."""


def read_speech(audio: Path, phones: Path) -> Speech:
    """Given sound with given phone times.

    Args:
        audio: any sound file; several channels are mixed to one.
        phones: JSON list of `[symbol, start, end]`: ARPAbet with or without stress, seconds. Gaps are silence.

    Raises:
        InputError: a file is missing or broken, or times do not fit to the sound.
    """
    samples, rate = read_sound(audio)
    try:
        entries = json.loads(phones.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{phones} cannot be read as JSON: {error}", field="phones") from error
    return Speech(samples, rate, _gapless(entries, len(samples) / rate, phones))


def _gapless(entries: object, duration: float, source: Path) -> tuple[Phone, ...]:
    """Phones from 0 to `duration` seconds without gaps."""
    given: list[Phone] = []
    if not isinstance(entries, list):
        raise InputError(f"{source} must hold a list", field="phones", advice='[["HH", 0.1, 0.17], …]')
    for number, entry in enumerate(entries):
        match entry:
            case [str() as name, int() | float() as start, int() | float() as end] if 0 <= start < end:
                pass
            case _:
                raise InputError(
                    f"{source}: entry {number} must be [symbol, start, end] with 0 <= start < end, not {entry!r}",
                    field="phones",
                )
        symbol = name.upper().rstrip("012") or SILENCE
        if symbol not in PHONES:
            raise InputError(
                f"{source}: entry {number}: {name!r} is no phone", field="phones", advice=f"Known: {' '.join(PHONES)}."
            )
        if given and start < given[-1].end - SMALLEST_GAP_SECONDS:
            raise InputError(f"{source}: entry {number} begins before the one before it ends", field="phones")
        given.append(Phone(symbol, float(start), float(end)))
    if given and given[-1].end > duration + TOLERANCE_SECONDS:
        raise InputError(f"{source} ends at {given[-1].end:.3f} s, the sound at {duration:.3f} s", field="phones")
    marks = [Phone(SILENCE, 0.0, 0.0), *given, Phone(SILENCE, duration, duration)]
    filled: list[Phone] = []
    for before, phone in pairwise(marks):
        start = before.end
        if phone.start - start > SMALLEST_GAP_SECONDS:
            filled.append(Phone(SILENCE, start, phone.start))
            start = phone.start
        if phone.end > start:
            filled.append(Phone(phone.symbol, start, phone.end))
    last = filled[-1]
    filled[-1] = Phone(last.symbol, last.start, duration)
    return tuple(phone for phone in filled if phone.end > phone.start)
