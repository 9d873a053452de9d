"""Audio-visual hidden Markov models with tied states (Wang 2010) as one kind of trajectory models among others."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from app.engine.models.hmm_context import questions
from app.engine.models.hmm_rows import HEARD, WINDOWS
from app.engine.models.hmm_states import SLOTS, Durations
from app.engine.models.hmm_stream import load_stream
from app.engine.models.hmm_training import learn
from app.engine.models.hmm_trajectory import Hearing, HmmTrajectory
from app.engine.models.model import Spoken
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack
from app.speech import PHONES, SILENCE

Float = NDArray[np.float32]


class HmmKind:
    """See `app.engine.models.model.Kind`."""

    name = "hmm"
    version = 1
    hears = False
    least = 10.0

    def fit(
        self, spoken: Sequence[Spoken], rest: Float, *, fps: float, seed: int, progress: Callable[[float], None]
    ) -> HmmTrajectory:
        """Settings chosen on sentences left out, then everything learnt from; nothing is random."""
        del seed
        return learn(spoken, rest, fps=fps, progress=progress)[0]

    def load(self, stored: StoredArrays) -> HmmTrajectory:
        """From `HmmTrajectory.to_arrays`."""
        phones = stored.names("phones")
        if SILENCE not in phones or list(phones) != [symbol for symbol in PHONES if symbol in phones]:
            raise BadPack(f"{stored.where}: the phones are not ARPAbet with silence, in its order")
        asked = questions().yes
        if not np.array_equal(stored.exact("questions", asked.shape), asked):
            raise BadPack(f"{stored.where}: its trees ask other questions than this version knows")
        rest = stored.numbers("rest", (-1,))
        scale = stored.exact("scale", rest.shape)
        fps, lead, dynamics = (float(number) for number in stored.exact("settings", (3,)))
        table = (len(PHONES), SLOTS)
        durations = Durations(stored.exact("duration_mean", table), stored.exact("duration_variance", table))
        ranges = (
            (scale > 0).all(), 0 < fps <= 1000, lead == round(lead), abs(lead) <= 1000, 0 < dynamics <= 1e6,
            (durations.mean > 0).all(), (durations.variance > 0).all(),
        )  # fmt: skip
        if not all(ranges):
            raise BadPack(f"{stored.where}: the scale, durations or settings are out of range")
        hearing = None
        if "grammar" in stored.arrays:
            grammar = stored.exact("grammar", (len(phones),) * 3)
            hearing = Hearing(load_stream(stored, "heard", HEARD), grammar)
        return HmmTrajectory(
            phones, load_stream(stored, "seen", WINDOWS * len(rest)), durations, hearing, scale, rest, fps, int(lead),
            dynamics,
        )  # fmt: skip
