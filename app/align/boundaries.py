"""Where phones really begin and end: corrects an engine's own phone times by the sound itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.align.phoneset import Sound
from app.speech import SILENCE

WINDOW = 0.020  # 20 ms of sound per energy value
STEP = 0.005  # 5 ms between energy values
GATE = 32.0  # dB under the loudest window: quieter is silence
SHORT_GAP = 0.120  # 120 ms: a shorter silence between phones is the space between two words, not a pause
LEAST_PHONE = 0.030  # 30 ms: an energy edge never shortens a phone below this
ONSET_REACH = 0.060  # 60 ms: how far before its nominal end a pause may be found to be over


def activity(samples: NDArray[np.float32], rate: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Which moments of a waveform are loud.

    Args:
        samples: shape (n,).
        rate: samples a second.

    Returns:
        centres of the windows in seconds, shape (m,), and whether each is loud, shape (m,); m = 0 for very short sound.
    """
    step, window = round(STEP * rate), round(WINDOW * rate)
    if len(samples) <= window:
        return np.zeros(0), np.zeros(0, dtype=np.bool_)
    energy = np.concatenate([[0.0], np.cumsum(np.square(samples, dtype=np.float64))])
    starts = np.arange(0, len(samples) - window, step)
    level = 10 * np.log10((energy[starts + window] - energy[starts]) / window + 1e-12)
    return (starts + window / 2) / rate, level > level.max() - GATE


def settle(sounds: Sequence[Sound], samples: NDArray[np.float32], rate: int, *, lag: float) -> list[Sound]:
    """Correct phone times that come from a network's durations.

    Such times trail the sound by a constant, count the spaces between words as silence, and put the end of the last
    phone before a pause far too late. So: everything moves `lag` earlier, short gaps are divided between their
    neighbours, and at pauses the phone ends (and the next begins) where the energy does.

    Args:
        sounds: gapless, beginning at 0.
        samples: the waveform, shape (n,).
        rate: samples a second.
        lag: seconds by which the times trail the sound.

    Returns:
        gapless sounds from 0 to the end of the samples.
    """
    duration = len(samples) / rate
    kept = _without_short_gaps(sounds)
    edges = np.clip([sound.end - lag for sound in kept], 0.0, duration)
    edges[-1] = duration
    times, loud = activity(samples, rate)
    for at in range(len(kept) - 1):
        start = edges[at - 1] if at else 0.0
        here, after = kept[at].symbol, kept[at + 1].symbol
        if here != SILENCE and after == SILENCE:
            quiet = times[(times >= start + LEAST_PHONE) & (times <= edges[at + 1]) & ~loud]
            if len(quiet) and quiet[0] < edges[at]:
                edges[at] = quiet[0]
        elif here == SILENCE and after != SILENCE:
            first = max(start, edges[at] - ONSET_REACH)
            onset = times[(times > first) & (times <= edges[at + 1] - LEAST_PHONE) & loud]
            if len(onset) and onset[0] > edges[at]:
                edges[at] = onset[0]
    edges = np.maximum.accumulate(edges)
    starts = [0.0, *edges[:-1].tolist()]
    return [
        replace(sound, start=start, end=end)
        for sound, start, end in zip(kept, starts, edges.tolist(), strict=True)
        if end > start
    ]


def _without_short_gaps(sounds: Sequence[Sound]) -> list[Sound]:
    kept: list[Sound] = []
    opened = None  # the middle of a gap just closed, where the next phone begins
    for at, sound in enumerate(sounds):
        inside = 0 < at < len(sounds) - 1
        if sound.symbol == SILENCE and inside and sound.end - sound.start <= SHORT_GAP:
            opened = (sound.start + sound.end) / 2
            kept[-1] = replace(kept[-1], end=opened)
        else:
            kept.append(sound if opened is None else replace(sound, start=opened))
            opened = None
    return kept
