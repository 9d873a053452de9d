"""The page `report.html`, and the film `report.mp4` beside it."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from pathlib import Path

from app.engine.pack import Pack
from app.engine.training.report.markup import Markup, text
from app.engine.training.report.motion import phones, trajectories, trials
from app.engine.training.report.side_by_side import choose_scenes, write_side_by_side
from app.engine.training.report.sights import film, loop, modes, prototypes, steadiness
from app.engine.training.report.sources import agreement, overview, rejected
from app.engine.training.report.template import PAGE as TEMPLATE
from app.engine.training.train import Learnt
from app.errors import TrainingFailed
from app.speech import Word

PAGE, FILM = "report.html", "report.mp4"
"""Both lie in the pack's folder: a new training replaces files there, and nothing else."""


def write_report(
    learnt: Learnt,
    pack: Pack,
    folder: Path,
    *,
    refused_clips: Sequence[tuple[str, str]] = (),
    agreement_lines: Sequence[str] = (),
    words: Mapping[str, Sequence[Word]] | None = None,
    date: datetime.date | None = None,
) -> None:
    """Write `report.html`, and `report.mp4` if there are sentences that nothing was learnt from.

    Args:
        learnt: what training learnt; its frames are still on disk.
        pack: the finished pack.
        folder: where to write.
        refused_clips: clips that training was not given, with the reason.
        agreement_lines: what was found about how text and sound agree.
        words: of takes, by their names, if they are known; seconds from the first picture. The film shows them.
        date: on the page; today's if not given.
    """
    scenes = choose_scenes(learnt)
    shown, problem = [learnt.corpus.takes[scene.passage.take].name for scene in scenes], ""
    try:
        if scenes:
            write_side_by_side(learnt, scenes, folder / FILM, words=words)
    except TrainingFailed as error:  # the avatar is finished: a mouth at the picture's edge must not lose it
        (folder / FILM).unlink(missing_ok=True)
        shown, problem = [], f"The film could not be made: {error.message}."
    parts: list[Markup] = [
        overview(learnt, pack),
        rejected(learnt, refused_clips),
        agreement(agreement_lines),
        film(shown, FILM, problem),
        steadiness(learnt),
        prototypes(learnt),
        modes(learnt),
        trials(learnt),
        trajectories(learnt),
        phones(learnt),
        loop(learnt, pack),
    ]
    page = TEMPLATE.substitute(
        title=text(f"{pack.manifest.title}: training report"),
        written=text((date or datetime.date.today()).isoformat()),
        content="\n".join(part for part in parts if part),
    )
    (folder / PAGE).write_text(page, encoding="utf-8")
