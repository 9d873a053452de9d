"""Mel-frequency cepstral coefficients: what a sound sounds like at some moments.

As Davis and Mermelstein (1980) have them, with the settings that speech recognisers use: pre-emphasis, a Hamming
window, the power spectrum, triangular filters at equal distances in mel (2595 log10(1 + f / 700)), logarithm, and an
orthonormal cosine transform whose first numbers are kept (the very first, the loudness, among them).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

Float = NDArray[np.float32]
Array = NDArray[np.float64]

RATE = 16_000
"""Samples a second of the sound that is analysed."""
COUNT = 20
"""Coefficients (Deena 2010 uses as many)."""
FILTERS = 40
LOWEST, HIGHEST = 60.0, 7600.0
"""Hz: edges of the first and of the last filter."""
PRE_EMPHASIS = 0.97
FLOOR = 1e-8
"""Power of a filter below which it counts as silent; samples are in [-1, 1]."""
WINDOW = 0.025
"""Seconds."""


def mfcc(samples: Float, centres: NDArray[np.floating[Any]], *, window: float = WINDOW) -> Float:
    """Coefficients at some moments.

    Args:
        samples: mono at `RATE`, in [-1, 1], shape (n,).
        centres: (T,) seconds from the first sample; before it and after the last there is silence.
        window: seconds that one vector hears, half of them before its centre.

    Returns:
        (T, COUNT), float32.
    """
    length = round(window * RATE)
    size = 1 << (length - 1).bit_length()
    # Pre-emphasis on the whole sound, not on each window: no window begins with a click.
    emphasised = np.append(samples[:1], samples[1:] - np.float32(PRE_EMPHASIS) * samples[:-1]).astype(np.float64)
    firsts = np.round(np.asarray(centres, np.float64) * RATE).astype(np.int64) - length // 2
    before = max(0, -int(firsts.min(initial=0)))
    after = max(0, int(firsts.max(initial=0)) + length - len(emphasised))
    padded = np.pad(emphasised, (before, after))
    cut = padded[(firsts + before)[:, None] + np.arange(length)] * np.hamming(length)
    power = np.abs(np.fft.rfft(cut, size, axis=1)) ** 2 / size
    loud = np.log(np.maximum(power @ _filters(size).T, FLOOR))
    cepstrum: Float = dct(loud, type=2, axis=1, norm="ortho")[:, :COUNT].astype(np.float32)
    return cepstrum


def mel(hertz: float | Array) -> Array:
    """Pitch as it is heard."""
    return np.asarray(2595.0 * np.log10(1.0 + np.asarray(hertz) / 700.0))


@lru_cache(maxsize=8)
def _filters(size: int) -> Array:
    """(FILTERS, size / 2 + 1) weights of the power spectrum of `size` samples."""
    edges = 700.0 * (10.0 ** (np.linspace(mel(LOWEST), mel(HIGHEST), FILTERS + 2) / 2595.0) - 1.0)
    bins = np.fft.rfftfreq(size, 1 / RATE)
    left, middle, right = (edges[at : at + FILTERS, None] for at in range(3))
    weights: Array = np.maximum(0.0, np.minimum((bins - left) / (middle - left), (right - bins) / (right - middle)))
    return weights
