"""What a trajectory model is, what it is trained on, and what a kind of models can do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from app.engine.models.sound import Sound
from app.engine.modes import Modes
from app.engine.stored_arrays import StoredArrays
from app.speech import Phone

Float = NDArray[np.float32]
Input = Literal["phones", "sound"]


@dataclass(frozen=True)
class Spoken:
    """A stretch of speech and the mouths that were seen.

    Attributes:
        phones: gapless, times in seconds from the first frame.
        coefficients: (T, K).
        counted: (T,) which frames are to be learnt from.
        sound: what was heard; None if nobody cut it out.
    """

    phones: tuple[Phone, ...]
    coefficients: Float
    counted: NDArray[np.bool_]
    sound: Sound | None = None


class TrajectoryModel(Protocol):
    """From phones or sound, or both, to mouth coefficients in the avatar's mode space. Used by several threads at once.

    Attributes:
        name: of its kind (`app.engine.models.registry`).
        rest: (K,) float32, the mouth in long silence.
        inputs: what it can speak from; each of them alone is enough.
    """

    @property
    def name(self) -> str: ...

    @property
    def rest(self) -> Float: ...

    @property
    def inputs(self) -> frozenset[Input]: ...

    def predict(
        self, phones: Sequence[Phone], frames: int, *, before: Float | None = None, sound: Sound | None = None
    ) -> Float:
        """Coefficients of every frame.

        Args:
            phones: gapless; frame n shows time n / fps of them. Before the first and after the last these two go on.
                None at all: only the sound is known, or, without one, there is silence.
            frames: T.
            before: (b, K) coefficients of the frames just before; the trajectory continues them smoothly.
            sound: what is heard, frame 0 at time 0; a model that needs none may leave it aside.

        Returns:
            (T, K), float32, finite.
        """

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Everything that `Kind.load` needs, as arrays without objects."""


@runtime_checkable
class Kind(Protocol):
    """A kind of trajectory models: trains them, and reads them from where they were stored.

    Attributes:
        name: small letters, digits and hyphens: the file's name in a pack.
        version: of what is stored; raised when older files cannot be read any more, or mean something else.
        hears: whether it cannot be trained without sound.
        least: seconds of speech below which it cannot be trained.
    """

    name: str
    version: int
    hears: bool
    least: float

    def fit(
        self, spoken: Sequence[Spoken], rest: Float, *, fps: float, seed: int, progress: Callable[[float], None]
    ) -> TrajectoryModel:
        """Train a model; call `app.engine.models.registry.fit`, which checks what goes in.

        Args:
            spoken: to train on, and to choose settings on.
            rest: (K,) the mouth at rest.
            fps: frames a second.
            seed: of everything random: the same seed gives the same model.
            progress: told the share done.
        """

    def load(self, stored: StoredArrays) -> TrajectoryModel:
        """The model of stored arrays (`TrajectoryModel.to_arrays`).

        Raises:
            BadPack: they are not what they should be.
            KeyError: one is missing.
        """


@runtime_checkable
class SeeingKind(Kind, Protocol):
    """A kind that is trained better if it knows what mouths look like.

    Attributes:
        sees: always True; tells it from other kinds.
    """

    sees: bool

    def fit(
        self, spoken: Sequence[Spoken], rest: Float, *, fps: float, seed: int, progress: Callable[[float], None],
        modes: Modes | None = None,
    ) -> TrajectoryModel:  # fmt: skip
        """See `Kind.fit`; `modes` draw mouths of the coefficients."""
