"""Audio-visual hidden Markov models with tied states (Wang 2010) as one kind of trajectory models among others."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from app.engine.models.hmm_training import learn
from app.engine.models.hmm_trajectory import HmmTrajectory
from app.engine.models.model import Spoken
from app.engine.stored_arrays import StoredArrays

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
