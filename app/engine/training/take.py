"""What training is given: videos with the phones that sound in them, and what of them could not be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.engine.pack import FPS
from app.errors import TrainingFailed
from app.speech import PHONES, SILENCE, Phone

PAUSE = 0.40
"""Seconds: takes are divided into passages in silences at least this long."""
LEAST_PASSAGE = 2.0
"""Seconds: no shorter passage is divided off."""
REST_AFTER, REST_BEFORE = 0.30, 0.16
"""Seconds of silence that the mouth may need to come to rest after speech, and to prepare for it."""


@dataclass(frozen=True, slots=True)
class Take:
    """One video and what is said in it.

    Attributes:
        name: unique; what reports call it.
        video: the file.
        phones: gapless, ARPAbet without stress, from 0 to the end of the sound, seconds after the first picture.
    """

    name: str
    video: Path
    phones: tuple[Phone, ...]


@dataclass(frozen=True, slots=True)
class Refusal:
    """A take, or one picture of it, that nothing was learnt from.

    Attributes:
        take: its name.
        frame: of the picture, at `FPS`; None for the whole take.
        reason: what was wrong.
    """

    take: str
    frame: int | None
    reason: str


def check_phones(phones: Sequence[Phone], where: str) -> None:
    """Raise `TrainingFailed` unless phones are known, in order and gapless."""
    if not phones:
        raise TrainingFailed(f"{where} holds no phones")
    for number, phone in enumerate(phones):
        if phone.symbol not in PHONES:
            raise TrainingFailed(f"{where}: phone {number} is {phone.symbol!r}, which is not ARPAbet without stress")
        if phone.end < phone.start or (number and abs(phone.start - phones[number - 1].end) > 1e-3):
            raise TrainingFailed(f"{where}: phone {number} ({phone.symbol}) does not start where the last one ends")


def passages(phones: Sequence[Phone], frames: int) -> list[range]:
    """Frames of a take divided in the middle of its long silences; together they are all of it.

    Within one passage head and mouth come back to one rest; over minutes, people sink in their chairs.
    """
    cuts = [0]
    spoken = phones[-1].end * FPS  # not `frames`: where the cuts are must not depend on how long the picture lasts
    for phone in phones[1:-1]:
        middle = round((phone.start + phone.end) / 2 * FPS)
        long = phone.symbol == SILENCE and phone.end - phone.start >= PAUSE
        if long and middle - cuts[-1] >= LEAST_PASSAGE * FPS and spoken - middle >= LEAST_PASSAGE * FPS:
            cuts.append(middle)
    cuts = [cut for cut in cuts if cut < frames or not cut]
    return [range(start, end) for start, end in zip(cuts, [*cuts[1:], frames], strict=True)]


def resting(phones: Sequence[Phone], frames: int) -> NDArray[np.bool_]:
    """(frames,) which frames show the mouth at rest: silence, but for a margin at the sides where speech is."""
    times = np.arange(frames) / FPS
    rest = np.zeros(frames, bool)
    last = len(phones) - 1
    for number, phone in enumerate(phones):
        if phone.symbol == SILENCE:
            start = phone.start + (REST_AFTER if number else -np.inf)
            end = phone.end - (REST_BEFORE if number < last else -np.inf)
            rest |= (times >= start) & (times <= end)
    return rest


def speaking(phones: Sequence[Phone], frames: int) -> NDArray[np.bool_]:
    """(frames,) which frames show a phone other than silence."""
    times = (np.arange(frames) + 0.5) / FPS
    spoken = np.zeros(frames, bool)
    for phone in phones:
        if phone.symbol != SILENCE:
            spoken |= (times >= phone.start) & (times < phone.end)
    return spoken
