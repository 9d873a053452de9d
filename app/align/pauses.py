"""Where speech begins and ends beside a pause: corrects an aligner there by the sound itself.

Inside speech an aligner is good to a hundredth of a second. Beside pauses it is not: the first phone swallows breath,
clicks and rumble of the room, or loses its own soft beginning. There the energy knows better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.align.boundaries import LEAST_PHONE, STEP, WINDOW
from app.align.phoneset import Sound
from app.speech import SILENCE

LEAST_PAUSE = 0.150  # 150 ms: beside shorter silences nothing is corrected
SHORT_GAP = 0.050  # 50 ms: a shorter silence is the space between two words and is divided between them
REACH = 0.250  # 250 ms: how far into a pause a phone may be made longer
BRIDGE = 0.040  # 40 ms: a shorter quiet moment does not end the speech
CLOSURE = 0.050  # 50 ms: a stop begins this long before it is heard, with the lips or the tongue closed
RELEASE = 0.120  # 120 ms: the longest silence inside a stop at the end, before it is released
LEAST_WEAK = 0.080  # 80 ms: weak fricatives may be lost in the noise, so they are not cut shorter than this
DEEPEST = 40.0  # dB under the loud parts: quieter is never speech
ONSET_LEVEL, END_LEVEL = 0.25, 0.15  # of the way from the level of the pauses to that of the loud parts (dB)

_STOPS = frozenset(["B", "P", "D", "T", "G", "K", "CH", "JH"])
_WEAK = frozenset(["F", "TH", "HH", "V", "DH"])


def close_gaps(sounds: Sequence[Sound]) -> list[Sound]:
    """Divide silences shorter than `SHORT_GAP` between their neighbours; those at both ends stay."""
    kept: list[Sound] = []
    opened: float | None = None
    for at, sound in enumerate(sounds):
        if sound.symbol == SILENCE and 0 < at < len(sounds) - 1 and sound.end - sound.start < SHORT_GAP:
            opened = (kept[-1].end + sound.end) / 2
            kept[-1] = replace(kept[-1], end=opened)
        else:
            kept.append(sound if opened is None else replace(sound, start=opened))
            opened = None
    return kept


def trim(sounds: Sequence[Sound], samples: NDArray[np.float32], rate: int) -> list[Sound]:
    """Move the first and last phone beside every pause to where the energy begins and ends.

    Args:
        sounds: gapless, with silences.
        samples: the waveform, shape (n,).
        rate: samples a second.

    Returns:
        gapless sounds, from 0 to the end of the samples if they were; only borders between a pause and a phone have
        moved, by at most `REACH` into the pause.
    """
    times, level = _level(samples, rate)
    if not len(times) or not sounds:
        return list(sounds)
    sounds = _between_pauses(sounds)
    floor, top = np.percentile(level, [10, 98])
    begins = level > max(floor + ONSET_LEVEL * (top - floor), top - DEEPEST)
    ends = level > max(floor + END_LEVEL * (top - floor), top - DEEPEST)
    last = len(sounds) - 2
    for at in range(last + 1):
        here, after = sounds[at], sounds[at + 1]
        if here.symbol == SILENCE and after.symbol != SILENCE and (at == 0 or _length(here) >= LEAST_PAUSE):
            edge = _onset(after, here, times, begins)
        elif here.symbol != SILENCE and after.symbol == SILENCE and (at == last or _length(after) >= LEAST_PAUSE):
            edge = _end(here, after, times, ends)
        else:
            continue
        sounds[at], sounds[at + 1] = replace(here, end=edge), replace(after, start=edge)
    return [sound for sound in sounds if sound.end > sound.start]


def _between_pauses(sounds: Sequence[Sound]) -> list[Sound]:
    """With a pause at both ends, of no length if there was none: a first phone may have swallowed it all."""
    start, end = sounds[0].start, sounds[-1].end
    before = [] if sounds[0].symbol == SILENCE else [Sound(SILENCE, start, start)]
    after = [] if sounds[-1].symbol == SILENCE else [Sound(SILENCE, end, end)]
    return [*before, *sounds, *after]


def _length(sound: Sound) -> float:
    return sound.end - sound.start


def _level(samples: NDArray[np.float32], rate: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres of windows (seconds) and their level (dB), rumble taken away by a first difference; shape (m,) each."""
    step, window = round(STEP * rate), round(WINDOW * rate)
    if len(samples) <= window:
        return np.zeros(0), np.zeros(0)
    energy = np.concatenate([[0.0], np.cumsum(np.square(np.diff(samples, prepend=samples[:1]), dtype=np.float64))])
    starts = np.arange(0, len(samples) - window, step)
    return (starts + window / 2) / rate, 10 * np.log10((energy[starts + window] - energy[starts]) / window + 1e-12)


def _onset(phone: Sound, pause: Sound, times: NDArray[np.float64], loud: NDArray[np.bool_]) -> float:
    """When the phone after a pause begins."""
    inside = np.flatnonzero(loud & (times >= phone.start) & (times <= phone.end + BRIDGE))
    later = np.flatnonzero(loud & (times > phone.end) & (times <= phone.end + REACH))
    if len(inside):
        anchor = int(inside[-1])
    elif len(later):
        anchor = int(later[0])
    else:
        return phone.start
    first = max(min(pause.start + LEAST_PHONE, phone.start), phone.start - REACH)
    edge = float(times[_run(anchor, -1, loud, BRIDGE)])
    if phone.symbol in _STOPS:
        edge -= CLOSURE
    return min(max(edge, first), phone.end - _least(phone))


def _end(phone: Sound, pause: Sound, times: NDArray[np.float64], loud: NDArray[np.bool_]) -> float:
    """When the phone before a pause ends."""
    inside = np.flatnonzero(loud & (times >= phone.start - BRIDGE) & (times <= phone.end))
    if not len(inside):
        return phone.end
    bridge = RELEASE if phone.symbol in _STOPS else BRIDGE
    edge = float(times[_run(int(inside[0]), 1, loud, bridge)])
    furthest = min(max(pause.end - LEAST_PHONE, phone.end), phone.end + REACH)
    return max(min(edge, furthest), phone.start + _least(phone))


def _run(at: int, step: int, loud: NDArray[np.bool_], bridge: float) -> int:
    """The last loud window of a run that begins at window `at`; quiet moments up to `bridge` seconds are part of it."""
    last, patience = at, round(bridge / STEP)
    while 0 <= at + step < len(loud) and abs(at - last) < patience:
        at += step
        if loud[at]:
            last = at
    return last


def _least(phone: Sound) -> float:
    return min(LEAST_WEAK if phone.symbol in _WEAK else LEAST_PHONE, _length(phone))
