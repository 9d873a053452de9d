"""The sound of a video file on the clock of its picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class ClipSound:
    """What is heard in a video; time 0 is the presentation time of its first picture.

    Attributes:
        samples: mono, float32 in [-1, 1], shape (n,).
        rate: samples a second.
        start: seconds from the first picture to the first sample that is in the file; before it there is silence. Less
            than 0 if sound before the first picture was cut off.
        lost: seconds of silence in place of sound that is missing or damaged in the file.
    """

    samples: NDArray[np.float32]
    rate: int
    start: float
    lost: float

    @property
    def duration(self) -> float:
        """Length in seconds, from the first picture on."""
        return len(self.samples) / self.rate


def read_clip_sound(video: Path) -> ClipSound:
    """The sound of a video on the clock of its picture.

    Raises:
        InputError: the file cannot be read or has no picture or no sound; the advice says what to do.
    """
    raise NotImplementedError
