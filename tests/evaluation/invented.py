"""An evaluation with invented figures: quick to make, and complete."""

from __future__ import annotations

import numpy as np

from app.align.agreement import Agreement, Starts
from app.engine.evaluation.comparison import Comparison, ModelRow
from app.engine.evaluation.measure import Example, Measured, Test
from app.engine.evaluation.model_scores import ModelScores
from app.engine.evaluation.nose import NoseMotion
from app.engine.evaluation.pictured import RenderedScores
from app.engine.evaluation.reconstruction import RENDERERS, Reconstruction
from app.engine.evaluation.scores import Closure, Gain, Scores, TrajectoryRow
from app.engine.evaluation.speech import SHOWN, Drawn, Sentence
from app.engine.evaluation.training_sizes import SizePoint
from app.engine.metrics import OpeningScores, PictureScores, TrajectoryScores
from app.engine.training.take import Refusal
from app.evaluation.evaluation import Evaluation
from app.speech import Phone

FRAMES, COUNT = 40, 5


def example(seed: int) -> Example:
    random = np.random.default_rng(seed)
    phones = (Phone("SIL", 0, 0.4), Phone("M", 0.4, 0.6), Phone("AA", 0.6, 1.2), Phone("SIL", 1.2, 1.6))
    counted = np.ones(FRAMES, bool)
    counted[3] = False
    speech = counted & (np.arange(FRAMES) >= 10) & (np.arange(FRAMES) < 30)
    true = random.standard_normal((FRAMES, COUNT)).astype(np.float32)
    scores = np.where(counted[:, None, None], random.uniform(20, 45, (FRAMES, len(SHOWN), 2)), np.nan)
    opening = np.where(counted, random.uniform(0, 1, FRAMES), np.nan)
    sentence = Sentence(
        f"clip {seed}", phones, np.arange(FRAMES), counted, speech, true, 0.8 * true, np.zeros(COUNT, np.float32)
    )  # fmt: skip
    return Example(sentence, Drawn(scores, opening, 0.9 * opening))


def scores(test: str, amplitude: float = 0.9) -> Scores:
    pictures = PictureScores(40.0, 37.5, 0.98, 100)
    trajectory = TrajectoryScores(0.6, 0.1, 0.5, 0.2, 0.4, 0.1, 0.7, 0.1, 0.8, 0.3, 2, 80)
    rows = tuple(
        TrajectoryRow(model, space, trajectory)
        for space in ("all modes", "leading modes")
        for model in ("avatar", "rest")
    )
    again = dict.fromkeys(RENDERERS, pictures)
    return Scores(
        test, 2, 2, 80, 40, rows, Reconstruction(40, 80, {**again, "literal": None}, again, None, pictures),
        dict.fromkeys(SHOWN, pictures), OpeningScores(0.9, 0, amplitude), Closure(1.0, 0.75, 4),
        (Gain(1.0, amplitude, 0.4, 33.0, 0.75), Gain(1.2, None, 0.5, float("nan"), None)),
        NoseMotion(0.5, 0.1, 0.2, 80),
    )  # fmt: skip


def comparison(test: str) -> Comparison:
    def row(model: str, error: float, speech: bool = True) -> ModelRow:
        trajectory = TrajectoryScores(error, 0.1, 0.5, 0.2, error / 2, 0.1, 0.7, 0.1, 0.8, 0.3, 2, 80)
        opening = OpeningScores(0.875, 1, 0.9) if speech else None
        pictures = PictureScores(33.25, 30.5, 0.9125, 80) if speech else None
        rendered = tuple(RenderedScores(name, pictures, 0.8, 1.1, 64_000.0, 0.75) for name in ("fast", "reference"))
        closings, unclosed = (4, 0.25) if speech else (0, float("nan"))
        return ModelRow(model, ModelScores(trajectory, opening, closings, unclosed, 62_500.0, 0.0125), rendered)

    return Comparison(test, 2, 2, (row("rest", 1.2, speech=False), row("gaussian", 0.6), row("analysed", 0.1)))


def invented(*tests: str) -> Evaluation:
    measured = Measured(
        tuple(Test(scores(name), (example(1), example(2))) for name in tests), np.array([3.0, 5.0, 1.0, 2.0, 2.0]), 3,
        (Refusal("clip 3", 7, "the face was lost"),), tuple(comparison(name) for name in tests),
        (
            SizePoint("hmm", 5, 0.25, None), SizePoint("gaussian", 5, 0.25, comparison("open").rows[1].scores),
            SizePoint("gaussian", 10, 0.5, comparison("open").rows[2].scores),
        ),
    )  # fmt: skip
    words = Agreement(9, Starts(8, 20.0, 40.0, -5.0, 0.1), None)
    refused = (Refusal("clip 4", None, "it has no transcript"), *measured.refused)
    return Evaluation("nobody", measured, words, refused, ("Only an open test.",))
