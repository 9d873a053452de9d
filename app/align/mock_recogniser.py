"""A recogniser that only hears whether there is sound: it opens and closes the mouth ten times a second."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

import numpy as np

from app.align.recogniser import RATE, Heard, Samples

STEP = 0.100  # seconds between two phones
LOUD = 0.01  # -40 dB: quieter is silence


class MockRecogniser:
    """See `app.align.recogniser.Recogniser`. The same sound always gives the same phones."""

    name = "mock"

    def warm_up(self) -> None:
        """Nothing is needed."""

    def hear(self, samples: Samples) -> Sequence[Heard]:
        step = round(STEP * RATE)
        symbols = cycle(("AA", "M"))
        return [
            Heard(next(symbols), (start + step / 2) / RATE)
            for start in range(0, len(samples) - step // 2, step)
            if float(np.abs(samples[start : start + step]).max()) >= LOUD
        ]
