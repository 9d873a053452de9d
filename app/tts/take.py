"""Pieces of sound with the times of their phones: cut to their silence, joined, and their words found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.align.boundaries import activity
from app.align.phoneset import Sound
from app.speech import SILENCE, Word

LEAD = 0.060  # 60 ms of silence before the first phone
TAIL = 0.060  # 60 ms after the last
FADE = 0.005  # 5 ms, where the model's own silence is cut
EDGE_REACH = 0.040  # 40 ms: how far outside the first and last phone sound still belongs to them


@dataclass(frozen=True, slots=True)
class Take:
    """Sound, shape (n,), and gapless phones from 0 to its end."""

    samples: NDArray[np.float32]
    sounds: list[Sound]


def trimmed(take: Take, rate: int) -> Take | None:
    """The take with the model's own silence at both ends cut to `LEAD` and `TAIL`; None if it is all silence."""
    inner = list(take.sounds)
    while inner and inner[0].symbol == SILENCE:
        inner.pop(0)
    while inner and inner[-1].symbol == SILENCE:
        inner.pop()
    if not inner:
        return None
    times, loud = activity(take.samples, rate)
    heard = times[loud]
    start, end = inner[0].start, inner[-1].end
    if len(heard):
        start = max(min(start, float(heard[0])), start - EDGE_REACH, 0.0)
        end = max(end, min(float(heard[-1]), end + EDGE_REACH))
    first, last = round((start - LEAD) * rate), round((end + TAIL) * rate)
    body = take.samples[max(0, first) : last].copy()
    ramp = np.linspace(0.0, 1.0, round(FADE * rate), dtype=np.float32)[: len(body)]
    body[: len(ramp)] *= ramp
    body[len(body) - len(ramp) :] *= ramp[::-1]
    samples = np.pad(body, (max(0, -first), max(0, last - len(take.samples))))
    samples /= max(1.0, float(np.abs(samples).max()))
    inner[0] = replace(inner[0], start=start)
    inner[-1] = replace(inner[-1], end=end)
    origin = first / rate
    sounds = [replace(sound, start=sound.start - origin, end=sound.end - origin) for sound in inner]
    lead, tail = Sound(SILENCE, 0.0, sounds[0].start), Sound(SILENCE, sounds[-1].end, len(samples) / rate)
    return Take(samples, [lead, *sounds, tail])


def joined(takes: Sequence[Take], rate: int) -> tuple[NDArray[np.float32], list[Sound]]:
    """Takes one after the other; silences that meet become one."""
    sounds: list[Sound] = []
    offset = 0
    for take in takes:
        shift = offset / rate
        moved = [replace(sound, start=sound.start + shift, end=sound.end + shift) for sound in take.sounds]
        if sounds:
            moved[0] = replace(moved[0], start=sounds.pop().start)
        sounds += moved
        offset += len(take.samples)
    return np.concatenate([take.samples for take in takes]), sounds


def words_of(sounds: Sequence[Sound], written: Sequence[tuple[str, range]]) -> tuple[Word, ...]:
    """The written words with the times of their phones; a word without a phone is left out."""
    times: dict[int, tuple[float, float]] = {}
    for sound in sounds:
        if sound.word >= 0:
            start = times[sound.word][0] if sound.word in times else sound.start
            times[sound.word] = (start, sound.end)
    words: list[Word] = []
    for text, span in written:
        spans = [times[number] for number in span if number in times]
        if spans:
            words.append(Word(text, spans[0][0], spans[-1][1]))
    return tuple(words)
