"""What the aligners are tried on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.align.transcript import Transcript

SENTENCES = (
    "She sells sea shells by the sea shore.",
    "My father bought five big boxes of fresh vegetables.",
    "The ship sailed through thick fog toward the harbor.",
    "Every morning she drinks a cup of strong black coffee.",
)


@dataclass(frozen=True)
class Clip:
    """One clip of a real talker: sound, shape (n,), and its transcript with word times."""

    name: str
    samples: NDArray[np.float32]
    rate: int
    transcript: Transcript
