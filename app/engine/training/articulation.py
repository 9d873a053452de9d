"""How a talker's mouth moves with the phones: the trajectory model, its settings chosen on sentences left out.

Settings that seeds leave open (how smooth, how far the lips are ahead, how long to train) differ from talker to talker.
They are chosen on a validation part of the recording; then everything is learnt from all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.engine.metrics import TrajectoryScores, trajectory_scores
from app.engine.models.model import Spoken
from app.engine.pack import FPS
from app.engine.training.corpus import Corpus
from app.engine.training.fit_trajectory import Options, descent, fit_trajectory, untrained
from app.engine.trajectory import GaussianTrajectory

Float = NDArray[np.float32]

LEFT_OUT = 6
"""Every so manyth passage is for validation."""
FEW = 36
"""Passages: with fewer, each is left out once, a `LEFT_OUT`th of them at a time; one part alone would not tell."""
LEAST_PASSAGES = 4
"""With fewer, nothing is chosen: the defaults stay."""
SMOOTHNESS = (0.3, 1.0, 3.0)
LEAD = (0.0, 0.02, 0.04, 0.06, 0.08)
"""Seconds."""
TRAINED_SMOOTHNESS = (1.0, 3.0)
"""For models trained by gradient: what is best without training is too rough for them."""
EPOCHS, EVERY = 40, 4
"""Of training at most, and between two looks at the validation part."""


@dataclass(frozen=True)
class Trial:
    """A trajectory model on the validation part.

    Attributes:
        name: what it is.
        scores: on sentences it has not learnt from.
    """

    name: str
    scores: TrajectoryScores


@dataclass(frozen=True)
class Articulation:
    """The trajectory model, and how it was come by.

    Attributes:
        model: learnt from everything.
        options: chosen.
        trials: models on the validation part, the shipped kind last; empty if the recording was too short for one.
        validation: numbers of the passages left out in the trials.
        predicted: for each of them (T, K) what the last trial's model, that has not heard it, says.
    """

    model: GaussianTrajectory
    options: Options
    trials: tuple[Trial, ...]
    validation: tuple[int, ...]
    predicted: tuple[Float, ...]


def spoken_passages(corpus: Corpus, coefficients: Float, rest: Float) -> list[Spoken]:
    """What was said and seen in every passage, its mouth at rest moved to the common one.

    Args:
        corpus: whose passages.
        coefficients: (T, K) of all frames.
        rest: (K,) the mouth at rest.
    """
    found = []
    for passage in corpus.passages:
        frames = np.arange(passage.frames.start, passage.frames.stop)
        found.append(
            Spoken(
                tuple(corpus.phones(passage)),
                (coefficients[frames] - rest_offset(corpus, coefficients, rest, frames)).astype(np.float32),
                corpus.good[frames],
            )
        )
    return found


def rest_offset(corpus: Corpus, coefficients: Float, rest: Float, frames: NDArray[np.int64]) -> Float:
    """(K,) how the mouth at rest of a passage differs from the common one; zero if it does not rest."""
    resting = frames[corpus.rest[frames] & corpus.good[frames]]
    if not len(resting):
        return np.zeros_like(rest)
    offset: Float = (coefficients[resting].mean(0) - rest).astype(np.float32)
    return offset


def learn_articulation(
    spoken: Sequence[Spoken], rest: Float, *, seed: int, progress: Callable[[float], None] = lambda _: None
) -> Articulation:
    """Choose the settings and train.

    Args:
        spoken: all passages; those without a counted frame are left out.
        rest: (K,) the mouth at rest.
        seed: of the order of training.
        progress: told the share done.
    """
    usable = [number for number, each in enumerate(spoken) if each.counted.any()]
    heard = [spoken[number] for number in usable]
    options = Options(seed=seed)
    if len(usable) < LEAST_PASSAGES:
        model = fit_trajectory(heard, rest, fps=FPS, options=options, progress=progress)
        return Articulation(model, options, (), (), ())
    count = min(LEFT_OUT, len(usable))
    parts = [list(range(part, len(usable), count)) for part in range(count)]
    folds = [_Fold.of(heard, part) for part in (parts if len(usable) < FEW else parts[count // 2 :][:1])]
    plain, scores = _tuned(folds, rest, replace(options, contexts=False))
    trials = [Trial("one Gaussian a phone, smoothed (eq. 3.2)", scores)]
    progress(0.1)
    _, scores, _ = _best_trained(folds, rest, plain, lambda share: progress(0.1 + 0.2 * share))
    trials.append(Trial("the same, trained by gradient", scores))
    wide, scores = _tuned(folds, rest, options)
    trials.append(Trial("Gaussians of halves beside their neighbours", scores))
    chosen, scores, predicted = _best_trained(folds, rest, wide, lambda share: progress(0.35 + 0.3 * share))
    trials.append(Trial("the same, trained by gradient (the avatar's kind)", scores))
    model = fit_trajectory(
        heard, rest, fps=FPS, options=chosen, progress=lambda share: progress(0.65 + 0.35 * share)
    )  # fmt: skip
    held = [usable[place] for fold in folds for place in fold.places]
    order = np.argsort(held)
    return Articulation(
        model, chosen, tuple(trials), tuple(held[at] for at in order), tuple(predicted[at] for at in order)
    )


@dataclass(frozen=True)
class _Fold:
    """A division of what was heard into a part to learn from and one to predict.

    Attributes:
        learnt, held: the two parts.
        places: of the second in what was heard.
    """

    learnt: tuple[Spoken, ...]
    held: tuple[Spoken, ...]
    places: tuple[int, ...]

    @classmethod
    def of(cls, heard: Sequence[Spoken], places: Sequence[int]) -> _Fold:
        learnt = tuple(each for place, each in enumerate(heard) if place not in places)
        return cls(learnt, tuple(heard[place] for place in places), tuple(places))


def predicted_by(model: GaussianTrajectory, held: Sequence[Spoken]) -> list[Float]:
    """(T, K) of every stretch of speech, as a model says it."""
    return [model.predict(each.phones, len(each.counted)) for each in held]


def _scored(models: Sequence[GaussianTrajectory], folds: Sequence[_Fold]) -> tuple[TrajectoryScores, list[Float]]:
    """A model for each fold against what its fold has left out, all of it together; and what they say."""
    predicted = [rows for model, fold in zip(models, folds, strict=True) for rows in predicted_by(model, fold.held)]
    true = [each.coefficients for fold in folds for each in fold.held]
    scale = np.mean([model.scale for model in models], 0)
    return trajectory_scores(predicted, true, scale), predicted


def _tuned(folds: Sequence[_Fold], rest: Float, options: Options) -> tuple[Options, TrajectoryScores]:
    """Smoothness and lead with the least error on what was left out."""
    best: tuple[float, Options, TrajectoryScores] | None = None
    for lead in LEAD:
        for smoothness in SMOOTHNESS:
            tried = replace(options, lead=lead, smoothness=smoothness)
            scores, _ = _scored([untrained(fold.learnt, rest, fps=FPS, options=tried) for fold in folds], folds)
            if best is None or scores.error_weighted < best[0]:
                best = scores.error_weighted, tried, scores
    assert best is not None
    return best[1], best[2]


def _best_trained(
    folds: Sequence[_Fold], rest: Float, options: Options, progress: Callable[[float], None]
) -> tuple[Options, TrajectoryScores, list[Float]]:
    """The best of training with each of `TRAINED_SMOOTHNESS`; see `_trained`."""
    count = len(TRAINED_SMOOTHNESS)
    tried = [
        _trained(
            folds, rest, replace(options, smoothness=smoothness),
            lambda share, at=at: progress((at + share) / count),  # type: ignore[misc]
        )
        for at, smoothness in enumerate(TRAINED_SMOOTHNESS)
    ]  # fmt: skip
    return min(tried, key=lambda trained: trained[1].error_weighted)


def _trained(
    folds: Sequence[_Fold], rest: Float, options: Options, progress: Callable[[float], None]
) -> tuple[Options, TrajectoryScores, list[Float]]:
    """As many epochs as help on what was left out; the scores then, and what the models say."""
    models = [untrained(fold.learnt, rest, fps=FPS, options=options) for fold in folds]
    best = _scored(models, folds)
    epochs = 0
    longest = replace(options, epochs=EPOCHS)
    each = [descent(model, fold.learnt, longest) for model, fold in zip(models, folds, strict=True)]
    for epoch, models_now in enumerate(zip(*each, strict=True), 1):
        progress(epoch / EPOCHS)
        if epoch % EVERY == 0:
            scored = _scored(models_now, folds)
            if scored[0].error_weighted < best[0].error_weighted:
                best, epochs = scored, epoch
    return replace(options, epochs=epochs), *best
