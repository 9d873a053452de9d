"""How much recording a trajectory model wants: trained on more and more of it, scored on the same unheard sentences.

Figure 9 of Wang 2010.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.engine.evaluation.comparison import Against
from app.engine.evaluation.model_scores import ModelScores, Recorded, Yardstick, score_model
from app.engine.models.model import Spoken
from app.engine.models.registry import fit
from app.engine.pack import FPS
from app.engine.training.corpus import Float, Progress
from app.errors import InputError, TrainingFailed


@dataclass(frozen=True, slots=True)
class SizePoint:
    """A model trained on a part of the recording.

    Attributes:
        model: its name.
        sentences: trained on.
        minutes: of recording that they are.
        scores: on the open test; None if the part is too small for it.
    """

    model: str
    sentences: int
    minutes: float
    scores: ModelScores | None


def training_sizes(
    learnt: Sequence[Recorded], unheard: Sequence[Recorded], rest: Float, by: Yardstick, against: Against,
    progress: Progress = lambda *_: None,
) -> tuple[SizePoint, ...]:  # fmt: skip
    """Train every model on parts of the sentences, each part within the next larger one.

    Args:
        learnt: sentences to train on.
        unheard: sentences to score on.
        rest: (K,) the mouth at rest.
        by: see `Yardstick`.
        against: the models, the sizes and the seed.
        progress: told the share done.

    Raises:
        InputError: there are not so many sentences, or none to score on.
    """
    if not against.sizes:
        return ()
    if not learnt or not unheard:
        raise InputError(
            "training sizes need clips that the avatar has learnt from and others", field="sizes",
            advice="Give the clips that it was trained on, too.",
        )  # fmt: skip
    if max(against.sizes) > len(learnt):
        raise InputError(f"there are {len(learnt)} sentences to train on, not {max(against.sizes)}", field="sizes")
    order = np.random.default_rng(against.seed).permutation(len(learnt))
    points = []
    jobs = [(size, name) for size in sorted(set(against.sizes)) for name in against.models]
    for number, (size, name) in enumerate(jobs):
        progress("training anew", number / len(jobs))
        part = [learnt[at] for at in order[:size]]
        spoken = [Spoken(each.phones, each.coefficients, each.counted, each.sound) for each in part]
        minutes = sum(len(each.counted) for each in part) / FPS / 60
        try:
            model = fit(name, spoken, rest, fps=FPS, seed=against.seed, modes=by.modes)
        except TrainingFailed:
            points.append(SizePoint(name, size, minutes, None))
            continue
        points.append(SizePoint(name, size, minutes, score_model(model.predict, unheard, by)))
    return tuple(points)
