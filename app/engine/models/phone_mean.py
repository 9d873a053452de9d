"""The baseline that every trajectory model has to beat: each frame shows the mean mouth of its phone, unsmoothed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.engine.models.labels import frame_phones
from app.engine.models.model import Input, Spoken
from app.engine.models.sound import Sound
from app.engine.states import nearest_phone
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack
from app.speech import PHONES, SILENCE, Phone

Float = NDArray[np.float32]


@dataclass(frozen=True)
class PhoneMean:
    """A mouth for every phone.

    Attributes:
        phones: that were seen in training, and silence.
        mean: (P, K) their mouths.
        rest: (K,) the mouth at rest.
        fps: frames a second.
    """

    phones: tuple[str, ...]
    mean: Float
    rest: Float
    fps: float

    name = "phone-mean"
    inputs: frozenset[Input] = frozenset({"phones"})

    def predict(
        self, phones: Sequence[Phone], frames: int, *, before: Float | None = None, sound: Sound | None = None
    ) -> Float:
        """See `app.engine.models.model.TrajectoryModel`; what was before and what is heard do not matter."""
        del before, sound
        rows = {symbol: row for row, symbol in enumerate(self.phones)}
        shown = [rows[nearest_phone(symbol, rows)] for symbol in frame_phones(phones, frames, self.fps)]
        return self.mean[shown].reshape(frames, len(self.rest))

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """See `app.engine.models.model.TrajectoryModel`."""
        return {
            "phones": np.array(self.phones), "mean": self.mean, "rest": self.rest,
            "fps": np.array([self.fps]),
        }  # fmt: skip


class PhoneMeanKind:
    """See `app.engine.models.model.Kind`."""

    name = "phone-mean"
    version = 1
    hears = False
    least = 0.5

    def fit(
        self, spoken: Sequence[Spoken], rest: Float, *, fps: float, seed: int, progress: Callable[[float], None]
    ) -> PhoneMean:
        """The mean of each phone's frames."""
        del seed
        coefficients = np.concatenate([each.coefficients[each.counted] for each in spoken]).astype(np.float64)
        labels = np.concatenate(
            [np.array(frame_phones(each.phones, len(each.counted), fps))[each.counted] for each in spoken]
        )
        seen = tuple(symbol for symbol in PHONES if symbol == SILENCE or (labels == symbol).any())
        mean = [coefficients[labels == symbol].mean(0) if (labels == symbol).any() else rest for symbol in seen]
        progress(1.0)
        return PhoneMean(seen, np.array(mean, np.float32), np.asarray(rest, np.float32), fps)

    def load(self, stored: StoredArrays) -> PhoneMean:
        """From `PhoneMean.to_arrays`."""
        phones = stored.names("phones")
        if SILENCE not in phones or not set(phones) <= set(PHONES):
            raise BadPack(f"{stored.where}: the phones are not ARPAbet with silence")
        rest = stored.numbers("rest", (-1,))
        return PhoneMean(
            phones, stored.numbers("mean", (len(phones), len(rest))), rest, float(stored.numbers("fps", (1,))[0])
        )
