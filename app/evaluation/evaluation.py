"""An avatar measured on what its talker was recorded saying, and what the reader of the figures must know."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from app.align.agreement import Agreement, agreement
from app.align.align_clips import Aligned
from app.engine.avatar import USUAL
from app.engine.evaluation.comparison import Against
from app.engine.evaluation.measure import Measured, measure
from app.engine.evaluation.pictured import Drawer
from app.engine.evaluation.talker import Talker
from app.engine.models.pack_models import PackModels
from app.engine.pack import load_pack
from app.engine.threads import one_thread_a_call
from app.engine.training.corpus import Progress
from app.engine.training.further_models import Hear
from app.engine.training.take import Refusal, Take
from app.engine.training.workspace import Workspace

VERSION = 1
"""Of the machine-readable form: raised when a figure changes its meaning or its place."""


@dataclass(frozen=True)
class Evaluation:
    """Everything found out.

    Attributes:
        avatar: its name.
        measured: figures and sentences.
        words: agreement of the word boundaries with the corpus's own, if it has some.
        refused: clips and pictures that were not used.
        notes: what the reader must know to read the figures.
    """

    avatar: str
    measured: Measured
    words: Agreement | None
    refused: tuple[Refusal, ...]
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """The machine-readable form; null: not measured.

        Version, avatar, notes, tests by name (each with its comparison of models), training sizes, words, refused. Of
        the same clips and avatar everything but `milliseconds` is the same.
        """
        tests = {}
        for each in self.measured.tests:
            scores = asdict(each.scores)
            scores["bars"] = [asdict(bar) | {"met": bar.met} for bar in each.scores.bars()]
            tests[each.scores.test] = scores
        for comparison in self.measured.comparisons:
            tests[comparison.test]["comparison"] = asdict(comparison)
        found: dict[str, Any] = _plain(
            {
                "version": VERSION, "avatar": self.avatar, "notes": self.notes, "tests": tests,
                "sizes": [asdict(each) for each in self.measured.sizes],
                "words": asdict(self.words) if self.words else None,
                "refused": [asdict(each) for each in self.refused],
            }
        )  # fmt: skip
        return found


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    return value


def evaluate(
    avatar: Path, takes: Sequence[Take], aligned: Aligned, *, gains: Sequence[float] = (),
    models: Sequence[str] | None = None, renderers: Sequence[str] = (USUAL,), sizes: Sequence[int] = (), seed: int = 0,
    hear: Hear | None = None, workers: int = 0, progress: Progress = lambda *_: None,
) -> Evaluation:  # fmt: skip
    """Measure an avatar.

    Args:
        avatar: folder of its pack.
        takes: what its talker was recorded saying.
        aligned: what the takes were made of, and the clips that could not be used.
        gains: see `app.engine.evaluation.scores.Gain`.
        models: trajectory models to compare; None: all that the pack has.
        renderers: to compare.
        sizes: numbers of sentences that the models are trained on anew; see `app.engine.evaluation.training_sizes`.
        seed: of that training.
        hear: gives the sound of takes.
        workers: processes; 0 for one a core.
        progress: told the step and the share of it that is done.

    Raises:
        BadPack: the pack is damaged.
        InputError: nothing can be measured on these takes.
        NotFound, MissingExtra: a model or renderer that is asked for.
    """
    one_thread_a_call()
    pack = load_pack(avatar)
    have = PackModels(pack)
    against = Against(
        {name: have.get(name) for name in (have.names() if models is None else models)},
        tuple(Drawer.of(pack, name) for name in renderers), hear, tuple(sizes), seed,
    )  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="mary-evaluate-") as folder:
        talker = Talker.of(pack)
        measured = measure(
            talker, takes, Workspace(Path(folder)), gains=gains, against=against, workers=workers, progress=progress
        )
    refused = [Refusal(each.clip.name, None, each.reason) for each in aligned.refused]
    notes = tuple(_notes(measured, talker))
    return Evaluation(talker.name, measured, agreement(aligned.spoken), (*refused, *measured.refused), notes)


def _notes(measured: Measured, talker: Talker) -> list[str]:
    tests = [each.scores.test for each in measured.tests]
    notes = []
    if tests == ["closed"]:
        notes.append("Only a closed test: the avatar has learnt from every one of these clips.")
    if tests == ["open"]:
        notes.append("Only an open test: the avatar has learnt from none of these clips.")
        if not talker.trained_on:
            notes.append("The avatar does not say what it was trained on: it may know these clips after all.")
    if measured.comparisons and not measured.own_space:
        notes.append("The common space comes from these clips themselves: give those of the training to have it fixed.")
    for each in measured.tests:
        drawn = each.scores.reconstruction
        if drawn.sampled < drawn.available:
            notes.append(
                f"Reconstruction ({each.scores.test}) is of {drawn.sampled} of {drawn.available} frames, evenly spread."
            )
    return notes
