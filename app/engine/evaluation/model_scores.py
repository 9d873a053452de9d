"""Trajectory models scored side by side, in one space and on the same sentences (Deena 2010, table 1)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.engine.evaluation.common_space import CommonSpace
from app.engine.evaluation.opening import LinearOpening, closed, closings
from app.engine.metrics import OpeningScores, TrajectoryScores, opening_scores, trajectory_scores
from app.engine.models.sound import Sound
from app.engine.modes import Modes
from app.speech import Phone

Float = NDArray[np.float32]


class Predict(Protocol):
    """What is scored: see `app.engine.models.model.TrajectoryModel.predict`."""

    def __call__(self, phones: Sequence[Phone], frames: int, *, sound: Sound | None = None) -> Float: ...


@dataclass(frozen=True)
class Recorded:
    """A sentence as it was recorded.

    Attributes:
        name: of it.
        phones: times from its first frame.
        sound: heard in it, if it was kept.
        counted: (T,) which frames could be read.
        coefficients: (T, K) analysed, without `offset`.
        offset: (K,) how its mouth at rest differs from the common one.
        common: (T, C) the frames themselves in the common space.
    """

    name: str
    phones: tuple[Phone, ...]
    sound: Sound | None
    counted: NDArray[np.bool_]
    coefficients: Float
    offset: Float
    common: Float


@dataclass(frozen=True)
class Yardstick:
    """What all models of one talker are measured with.

    Attributes:
        space: the common one.
        modes: that draw.
        opening: of the mouth, from mode coefficients.
        lead: seconds by which the talker's lips are ahead of the sound.
    """

    space: CommonSpace
    modes: Modes
    opening: LinearOpening
    lead: float


@dataclass(frozen=True, slots=True)
class ModelScores:
    """One model.

    Attributes:
        trajectory: in the common space.
        opening: of the mouth, against the analysed one; None if no sentence is long enough.
        closings: how many /m b p/ at which the recorded lips close.
        unclosed: share of them at which the model's lips do not; NaN if there are none.
        squares: eq. 16 of Wang 2010: mean over frames of the squared distance in the common space, which is not divided
            by its deviations for it.
        milliseconds: of prediction a frame, the median over sentences.
    """

    trajectory: TrajectoryScores
    opening: OpeningScores | None
    closings: int
    unclosed: float
    squares: float
    milliseconds: float


def score_model(predict: Predict, said: Sequence[Recorded], by: Yardstick) -> ModelScores:
    """Have a model say what was recorded, and compare.

    Args:
        predict: of the model.
        said: sentences.
        by: see `Yardstick`.
    """
    rows, milliseconds = say(predict, said)
    return score_rows(rows, said, by, milliseconds=milliseconds)


def say(predict: Predict, said: Sequence[Recorded]) -> tuple[list[Float], float]:
    """What a model says, (T, K) of each sentence, and the milliseconds a frame, the median over sentences."""
    rows, spent = [], []
    for each in said:
        begin = time.perf_counter()
        rows.append(predict(each.phones, len(each.counted), sound=each.sound))
        spent.append((time.perf_counter() - begin) * 1000 / len(each.counted))
    return rows, float(np.median(spent))


def score_rows(
    rows: Sequence[Float], said: Sequence[Recorded], by: Yardstick, *, milliseconds: float = 0.0
) -> ModelScores:
    """Score coefficients (T, K) of each sentence, without its offset; see `score_model`."""
    shown, true, openings, closures = [], [], [], []
    for one, each in zip(rows, said, strict=True):
        counted = each.counted
        if one.shape != each.coefficients.shape or not np.isfinite(one).all():
            raise ValueError(f"{each.name}: a model says {one.shape}, finite: {np.isfinite(one).all()}")
        drawn = by.space.of_mouths((one + each.offset)[counted].astype(np.float32), by.modes)
        shown.append(drawn * by.space.scale)
        true.append(each.common[counted] * by.space.scale)
        opened, recorded = by.opening.of(one), by.opening.of(each.coefficients)
        openings.append((opened[counted], recorded[counted]))
        when = [stretch for stretch in closings(each.phones, len(one), by.lead) if counted[stretch].all()]
        closures += [
            shut for closing, shut in zip(closed(recorded, when), closed(opened, when), strict=True) if closing
        ]
    squares = np.concatenate([np.square(a - b, dtype=np.float64).sum(1) for a, b in zip(shown, true, strict=True)])
    return ModelScores(
        trajectory_scores(shown, true, by.space.scale), opening_scores(*zip(*openings, strict=True)),
        len(closures), float(1 - np.mean(closures)) if closures else float("nan"), float(squares.mean()), milliseconds,
    )  # fmt: skip
