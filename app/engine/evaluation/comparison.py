"""All trajectory models of an avatar, and all renderers, on the same sentences: the tables of Deena 2010 and Wang 2010.

Trajectories are scored in the common space (`app.engine.evaluation.common_space`), drawn by the serving modes whatever
renderer there is. Renderers are scored by their pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.engine.evaluation.common_space import CommonSpace, learn_common_space
from app.engine.evaluation.model_scores import ModelScores, Recorded, Yardstick, say, score_rows
from app.engine.evaluation.opening import LinearOpening, Lips
from app.engine.evaluation.pictured import Drawer, Gallery, RenderedScores, draw_sentence
from app.engine.evaluation.speech import Sentence
from app.engine.evaluation.talker import Talker
from app.engine.models.model import TrajectoryModel
from app.engine.models.sound import Sound
from app.engine.pack import FPS
from app.engine.training.corpus import Corpus, Progress, without
from app.engine.training.further_models import Hear

Float = NDArray[np.float32]

REST, ANALYSED = "rest", "analysed"
"""Rows that are no models: the mouth that does not move, and the analysed coefficients themselves, the ceiling."""
ENOUGH = 250
"""Frames of training clips from which components are learnt; with fewer, all clips give them."""
PICTURED = 40
"""Sentences of a test that are drawn at most, evenly spread."""


@dataclass(frozen=True)
class Against:
    """What is compared.

    Attributes:
        models: by name.
        drawers: the renderers.
        hear: gives the sound of takes; None: models that need it cannot be compared.
        sizes: numbers of sentences to train the models on anew, for the curve; see `training_sizes`.
        seed: of that training.
    """

    models: Mapping[str, TrajectoryModel]
    drawers: tuple[Drawer, ...]
    hear: Hear | None = None
    sizes: tuple[int, ...] = ()
    seed: int = 0


@dataclass(frozen=True, slots=True)
class ModelRow:
    """One model in one test.

    Attributes:
        model: its name, or `REST` or `ANALYSED`.
        scores: of its trajectories.
        rendered: of its pictures, by each renderer.
    """

    model: str
    scores: ModelScores
    rendered: tuple[RenderedScores, ...]


@dataclass(frozen=True, slots=True)
class Comparison:
    """All models in one test.

    Attributes:
        test: `OPEN` or `CLOSED`.
        sentences: how many were scored.
        pictured: how many of them were drawn by the renderers.
        rows: one for each model, `REST` first and `ANALYSED` last.
    """

    test: str
    sentences: int
    pictured: int
    rows: tuple[ModelRow, ...]


def yardstick(talker: Talker, corpus: Corpus, learnt: NDArray[np.bool_]) -> tuple[Yardstick, bool]:
    """What all models are measured with, and whether its space comes from the avatar's training clips.

    Args:
        talker: whose models.
        corpus: of all clips at hand.
        learnt: (T,) which frames the avatar has learnt from: their components are taken, if there are enough of them.
    """
    others = [number for number, each in enumerate(corpus.passages) if not learnt[each.frames.start]]
    known = without(corpus, others)
    enough = int(known.good.sum()) >= ENOUGH
    space = learn_common_space(known if enough else corpus)
    opening = LinearOpening.of_modes(Lips.of(talker.morphable, talker.window), talker.modes)
    return Yardstick(space, talker.modes, opening, talker.trajectory.lead), enough


def recorded(said: Sequence[Sentence], corpus: Corpus, space: CommonSpace, hear: Hear | None) -> list[Recorded]:
    """Sentences with their sound and their frames in the common space."""
    owner = np.repeat(np.arange(len(corpus.takes)), np.diff(corpus.starts))
    sounds: dict[int, Sound] = {}
    found = []
    for each in said:
        take = int(owner[each.numbers[0]])
        if hear is not None and take not in sounds:
            sounds = {take: hear(corpus.takes[take])}  # those of the next take are wanted next
        sound = sounds[take].moved(float(each.numbers[0] - corpus.starts[take]) / FPS) if hear is not None else None
        common = np.zeros((len(each.numbers), len(space.scale)), np.float32)
        common[each.counted] = space.of_frames(corpus.frames, each.numbers[each.counted])
        found.append(Recorded(each.name, each.phones, sound, each.counted, each.true, each.offset, common))
    return found


def compare(
    test: str, said: Sequence[Sentence], corpus: Corpus, talker: Talker, by: Yardstick, against: Against,
    progress: Progress = lambda *_: None,
) -> Comparison:  # fmt: skip
    """Score all models in one test.

    Args:
        test: its name.
        said: its sentences.
        corpus: whose.
        talker: of the avatar.
        by: see `yardstick`.
        against: see `Against`.
        progress: told the share done.
    """
    true = recorded(said, corpus, by.space, against.hear)
    chosen = np.unique(np.linspace(0, len(said) - 1, min(PICTURED, len(said))).round().astype(int))
    names = [REST, *against.models, ANALYSED]
    rows = []
    for number, name in enumerate(names):
        progress("comparing", number / len(names))
        milliseconds = 0.0
        if name == REST:
            given = [talker.trajectory.rest[None].repeat(len(each.counted), 0) for each in true]
        elif name == ANALYSED:
            given = [each.coefficients for each in true]
        else:
            given, milliseconds = say(against.models[name].predict, true)
        scores = score_rows(given, true, by, milliseconds=milliseconds)
        drawn = tuple(_drawn(drawer, given, said, true, chosen, corpus, talker, by) for drawer in against.drawers)
        rows.append(ModelRow(name, scores, drawn))
    return Comparison(test, len(said), len(chosen), tuple(rows))


def _drawn(
    drawer: Drawer, rows: Sequence[Float], said: Sequence[Sentence], true: Sequence[Recorded],
    chosen: NDArray[np.int64], corpus: Corpus, talker: Talker, by: Yardstick,
) -> RenderedScores:  # fmt: skip
    gallery = Gallery(drawer.name, talker.window)
    height, width = talker.modes.height, talker.modes.width
    for at in chosen:
        counted = said[at].counted
        shown, spent = draw_sentence(drawer, rows[at], said[at].offset)
        shown = shown[counted]
        frames = corpus.frames.take(said[at].numbers[counted])[:, : height * width].reshape(-1, height, width)
        difference = (by.space.of(shown) - true[at].common[counted]) * by.space.scale
        gallery.add(shown, frames, said[at].speech[counted], np.square(difference, dtype=np.float64).sum(1), spent)
    return gallery.scores()
