"""The Gaussians of `app.engine.trajectory` as one kind of trajectory models among others (Fu 2011; Ezzat 2002)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from app.engine.models.model import Spoken
from app.engine.stored_arrays import StoredArrays
from app.engine.trajectory import GaussianTrajectory
from app.errors import BadPack
from app.speech import SILENCE


class GaussianKind:
    """See `app.engine.models.model.Kind`."""

    name = "gaussian"
    version = 1
    hears = False
    least = 0.5

    def fit(
        self, spoken: Sequence[Spoken], rest: NDArray[np.float32], *, fps: float, seed: int,
        progress: Callable[[float], None],
    ) -> GaussianTrajectory:  # fmt: skip
        """Settings chosen on sentences left out, then everything learnt from; `fps` is that of all packs."""
        del fps
        from app.engine.training.articulation import learn_articulation

        return learn_articulation(spoken, rest, seed=seed, progress=progress).model

    def load(self, stored: StoredArrays) -> GaussianTrajectory:
        """From `GaussianTrajectory.to_arrays`."""
        return load_gaussian(stored)


def load_gaussian(stored: StoredArrays) -> GaussianTrajectory:
    """The Gaussians in a pack's arrays.

    Raises:
        BadPack: they are not what they should be.
        KeyError: an array is missing.
    """
    states = stored.names("states")
    if SILENCE not in states:
        raise BadPack(f"{stored.where}: the trajectory model has no silence")
    offset = stored.numbers("coefficient_offset", (-1,))
    scale = stored.numbers("coefficient_scale", offset.shape)
    shape = (len(states), len(offset))
    mean, precision = (stored.numbers(name, shape) for name in ("state_mean", "state_precision"))
    fps, smoothness, order, lead, cap = (float(number) for number in stored.numbers("trajectory", (5,)))
    if not ((precision > 0).all() and (scale > 0).all() and smoothness > 0 and 1 <= order <= 8 and cap > 0):
        raise BadPack(
            f"{stored.where}: the trajectory model's variances, scale, smoothness, order or cap are out of range"
        )
    exact = [np.asarray(array, np.float64) for array in (mean, precision, offset, scale)]
    return GaussianTrajectory(states, exact[0], exact[1], exact[2], exact[3], fps, smoothness, int(order), lead, cap)
