"""Sound against picture: how far the one is behind the other, and when sound begins and ends."""

from __future__ import annotations

import numpy as np

from bench.watched import Floats, Series

LOUD = -45.0
"""dB below full scale: speech is some 25 dB above this, what coding leaves of silence far below."""
QUIETEST = -60.0
"""dB: silence is silence, however deep."""
SMOOTH = 0.08
"""Seconds over which sound is averaged: two pictures, as the mouth cannot follow anything faster."""
FARTHEST, STEP = 0.4, 0.005
"""Seconds of offset that are tried."""
PEAK = 0.07
"""Seconds around the best offset through which the parabola is laid."""
SHUT, OPEN = 1.0, 4.0
"""Levels between which a mouth opens: how far it does depends on the vowel and not on the loudness."""


def offset(mouth: Series, sound: Series) -> float:
    """Seconds by which the sound comes after the movement of the mouth that goes with it.

    Where loudness and opening of the mouth are most alike: the top of a parabola through the correlations around the
    largest. Mouths open before they sound, and how long before depends on what is said, so that it is the difference of
    two stretches of speech that means something, and more so the longer they are: over stretches of 29 s of the default
    avatar's talk the standard deviation is 4 ms, of 58 s 2 ms.

    Args:
        mouth: how far it is from closed, see `MouthGauge`.
        sound: dB; read where the mouth is known and 0.4 s beyond, if it is there.

    Raises:
        ValueError: nothing moves, or nothing is to be heard.
    """
    opening = np.clip(mouth.values, SHUT, OPEN)
    if not len(opening) or not np.ptp(opening) or not (sound.values > LOUD).any():
        raise ValueError("there is no speech here")
    loudness = _smooth(Series(sound.times, np.maximum(sound.values, QUIETEST)))
    lags = np.arange(-FARTHEST, FARTHEST + STEP / 2, STEP)
    alike = np.array(
        [np.corrcoef(opening, np.interp(mouth.times + lag, loudness.times, loudness.values))[0, 1] for lag in lags]
    )
    near = np.abs(lags - lags[alike.argmax()]) <= PEAK
    bend, slope, _ = np.polyfit(lags[near], alike[near], 2)
    return float(-slope / (2 * bend))


def onset(sound: Series, start: float, end: float) -> float | None:
    """When sound begins again after the longest silence between two moments; None if there is none of both."""
    part = sound.within(start, end)
    quiet = np.concatenate([[False], part.values <= LOUD, [False]]).astype(int)
    runs = np.flatnonzero(np.diff(quiet)).reshape(-1, 2)
    if not len(runs):
        return None
    after = runs[(runs[:, 1] - runs[:, 0]).argmax(), 1]
    return float(part.times[after]) if after < len(part.times) else None


def last_loud(sound: Series, start: float, end: float) -> float | None:
    """When the last loud sound between two moments ends; None if all is quiet."""
    part = sound.within(start, end)
    loud = np.flatnonzero(part.values > LOUD)
    if not len(loud):
        return None
    return float(part.times[loud[-1]] + np.median(np.diff(part.times)))


def _smooth(sound: Series) -> Series:
    grid: Floats = np.arange(sound.times[0], sound.times[-1], STEP)
    width = round(SMOOTH / STEP)
    even = np.interp(grid, sound.times, sound.values)
    padded = np.pad(even, (width // 2, width - 1 - width // 2), mode="edge")
    return Series(grid, np.convolve(padded, np.full(width, 1 / width), "valid"))
