"""Phones as one label a frame (Deena 2010, figure 3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.speech import SILENCE, Phone


def frame_phones(phones: Sequence[Phone], frames: int, fps: float) -> list[str]:
    """The phone that sounds at n / fps for every frame n; the first and the last go on, none at all are silence."""
    if not phones:
        return [SILENCE] * frames
    ends = np.array([phone.end for phone in phones])
    places = np.searchsorted(ends, np.arange(frames) / fps, side="right")
    return [phones[place].symbol for place in np.minimum(places, len(phones) - 1)]
