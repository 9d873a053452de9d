"""What the hidden Markov models observe: sound and mouth at one rate, with their dynamics (Wang 2010, 3.2 and 4.1).

Mouths are interpolated up to `ROWS` rows a frame (5 ms at 25 fps, the step of Wang's sound); row `ROWS` n is frame n.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from app.engine.models.mfcc import COUNT, mfcc
from app.engine.models.sound import Sound

Float = NDArray[np.float32]
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ROWS = 8
"""A frame."""
WINDOWS = 3
"""Static, delta, delta-delta."""
HEARD = WINDOWS * COUNT
"""Dimensions of what is heard."""


def rows_of(frames: int) -> int:
    """Rows from the first frame to the last."""
    return max(0, (frames - 1) * ROWS + 1)


def with_dynamics(rows: Array) -> Array:
    """Add (c[t + 1] - c[t - 1]) / 2 and c[t + 1] - 2 c[t] + c[t - 1]; the ends stand still outside.

    Args:
        rows: (R, K).

    Returns:
        (R, 3 K): static, delta, delta-delta.
    """
    padded = np.concatenate([rows[:1], rows, rows[-1:]])
    after, before = padded[2:], padded[:-2]
    return np.concatenate([rows, (after - before) / 2, after - 2 * rows + before], axis=1)


def heard_rows(sound: Sound, first: int, count: int, fps: float) -> Array:
    """MFCC with dynamics of some rows.

    Args:
        sound: see there.
        first: row, may be less than 0.
        count: of rows.
        fps: frames a second.

    Returns:
        (count, HEARD).
    """
    times = (np.arange(first - 1, first + count + 1)) / (ROWS * fps) - sound.start
    return with_dynamics(mfcc(sound.heard, times).astype(np.float64))[1:-1]


def seen_rows(coefficients: NDArray[np.floating[Any]], counted: Flags, first: float, count: int) -> tuple[Array, Flags]:
    """Mouths with dynamics of some rows, by cubic interpolation between frames.

    Args:
        coefficients: (T, K); rows that do not count may hold anything.
        counted: (T,) frames that are to be learnt from, at least one.
        first: row, may lie between two.
        count: of rows.

    Returns:
        (count, 3 K), and which of them lie between frames that count (dynamics included).
    """
    places = first + np.arange(-1, count + 1, dtype=np.float64)
    known = np.flatnonzero(counted)
    at = np.clip(places / ROWS, known[0], known[-1])
    if len(known) == 1:
        rows = np.repeat(coefficients[known].astype(np.float64), len(at), axis=0)
    else:
        rows = CubicSpline(known, coefficients[known].astype(np.float64), bc_type="natural")(at)
    sure = np.zeros(len(places), bool)
    inside = (places >= 0) & (places <= (len(counted) - 1) * ROWS)
    low, high = (np.clip(side(places / ROWS), 0, len(counted) - 1).astype(int) for side in (np.floor, np.ceil))
    sure[inside] = (counted[low] & counted[high])[inside]
    return with_dynamics(rows)[1:-1], sure[1:-1] & sure[2:] & sure[:-2]
