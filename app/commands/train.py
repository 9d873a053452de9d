"""`mary train`: from somebody's recording to an avatar that `mary serve` offers."""

from __future__ import annotations

import fcntl
import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import typer
from rich.console import Console
from rich.text import Text

from app.align.agreement import agreement
from app.align.align_clips import Aligned
from app.align.clips import find_clips
from app.commands.long_work import LongWork, shown
from app.commands.takes import hear, spoken_takes
from app.engine.pack import Manifest, Pack
from app.engine.selection_library import NAME as SELECTION
from app.engine.training.further_models import check_further
from app.engine.training.identity import Identity, read_identity
from app.engine.training.report.page import write_report
from app.engine.training.take import Refusal, Take
from app.engine.training.train import Learnt, train, workspace_of
from app.errors import InputError, TrainingFailed

STEPS = {
    "listening": 16.0, "finding the face": 6.0, "following the face": 32.0, "cutting out the mouth": 10.0,
    "components": 4.0, "landmarks": 2.0, "flow": 26.0, "modes": 5.0, "textures": 1.5, "analysis": 6.0,
    "trajectories": 26.0, "background": 2.0, "writing": 3.0, "further models": 60.0, "samples": 20.0,
    "report": 12.0,
}  # fmt: skip
"""Seconds of each step for 250 clips of three seconds on two cores (and of each further model): for the time left."""
IDENTITY = "avatar.json"


@dataclass(frozen=True)
class Asked:
    """What the caller says of the avatar; what is empty is asked for, or taken as usual."""

    identity: Path | None
    title: str
    voice: str
    licence: str
    subject: str
    consent: str


def run(
    inputs: Sequence[Path],
    transcripts: Sequence[Path],
    output: Path,
    asked: Asked,
    *,
    background: Path | None,
    leave_out: Sequence[str],
    models: Sequence[str],
    aligner: str,
    seed: int,
    workers: int,
    out: Console,
    err: Console,
) -> Manifest:
    """Train an avatar, showing progress.

    Raises:
        InputError: the videos, transcripts or the output's name cannot be used.
        NotFound: there is no such trajectory model.
        TrainingFailed: no consent, or nothing can be learnt from the recording; says why.
    """
    if not re.fullmatch(r"[a-z0-9][a-z0-9_-]{0,63}", output.name):
        raise InputError(
            f"{output.name!r} cannot be an avatar's name", field="output",
            advice="Use small letters, digits, - and _, as in: -o avatars/anna",
        )  # fmt: skip
    if background is not None and not background.is_file():
        raise InputError(f"{background} is no video", field="background")
    check_further(models)
    clips = find_clips(inputs, transcripts)  # what is missing is said before anybody is asked anything
    _check_left_out(leave_out, [clip.name for clip in clips])
    workspace = workspace_of(output)
    identity = _identity(asked, output, workspace, err)
    refused: list[Refusal] = []
    used: list[str] = []
    with _alone(_made(workspace)), _resumable(err), shown(err, LongWork(_steps(models))) as work:
        takes, aligned = spoken_takes(
            clips, aligner=aligner, cache=workspace / "alignments", workers=workers,
            progress=lambda share: work.tell("listening", share),
        )  # fmt: skip
        for each in aligned.refused:
            err.print(Text(f"not used: {each.clip.name}: {each.reason}"), soft_wrap=True)

        def extras(learnt: Learnt, pack: Pack, draft: Path) -> None:
            refused.extend(each for each in learnt.corpus.refused if each.frame is None)
            used.extend(take.name for take in learnt.corpus.takes)
            work.tell("report", 0)
            _report(learnt, pack, draft, aligned)
            (draft / IDENTITY).write_text(_described(identity), encoding="utf-8")

        takes, sentences = _left_out(leave_out, takes)
        manifest = train(
            takes, identity, output, background=background, leave_out=sentences, models=models, hear=hear, seed=seed,
            workers=workers, progress=work.tell, extras=extras,
        )  # fmt: skip
    for broken in refused:
        err.print(Text(f"not used: {broken.take}: {broken.reason}"), soft_wrap=True)
    _summary(manifest, aligned, len(used), output, out)
    return manifest


def _steps(models: Sequence[str]) -> dict[str, float]:
    kinds = check_further(models)
    return {
        **STEPS, "further models": STEPS["further models"] * len(kinds),
        "samples": STEPS["samples"] * (SELECTION in models),
    }  # fmt: skip


def _left_out(leave_out: Sequence[str], takes: Sequence[Take]) -> tuple[list[Take], list[int]]:
    """The clips that are left, and the numbers of sentences to leave out of a single one."""
    if len(takes) == 1 and all(name.isdigit() for name in leave_out):
        return list(takes), [int(name) for name in leave_out]
    left = [take for take in takes if take.name not in leave_out]
    if not left:
        raise InputError("no clip is left to learn from", field="leave_out")
    return left, []


def _check_left_out(leave_out: Sequence[str], names: Sequence[str]) -> None:
    if len(names) == 1 and all(name.isdigit() for name in leave_out):
        return
    unknown = sorted(set(leave_out) - set(names))
    if unknown:
        known = ", ".join(names[:3]) + (", …" if len(names) > 3 else "")
        raise InputError(
            f"there is no clip {unknown[0]!r} to leave out", field="leave_out", advice=f"The clips are {known}."
        )


@contextmanager
def _alone(workspace: Path) -> Iterator[None]:
    """One training at a time for one output: two would take each other's finished steps away."""
    with (workspace / "lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise InputError(
                "this avatar is being trained already", field="output", advice="Wait for it, or name another output."
            ) from error
        yield


@contextmanager
def _resumable(err: Console) -> Iterator[None]:
    """Says, where work is broken off, that it is not lost."""
    try:
        yield
    except KeyboardInterrupt:
        err.print("stopped; the same command goes on from here", highlight=False)
        raise


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder.parent} cannot be written: {error.strerror}", field="output", advice="Name another output."
        ) from error
    return folder


def _report(learnt: Learnt, pack: Pack, draft: Path, aligned: Aligned) -> None:
    write_report(
        learnt, pack, draft, refused_clips=[(each.clip.name, each.reason) for each in aligned.refused],
        agreement_lines=_agreement(aligned), words={each.clip.name: each.words for each in aligned.spoken},
    )  # fmt: skip


def _agreement(aligned: Aligned) -> list[str]:
    """How the words found agree with times that the transcripts bring along, in sentences."""
    found = agreement(aligned.spoken)
    if found is None:
        return []
    each = (("word starts inside clips", found.inner), ("first words of clips", found.onsets))
    return [
        f"{name}: {starts.median:.0f} ms from the transcripts' own at the median, {starts.p90:.0f} ms at 90 %"
        for name, starts in each
        if starts is not None
    ]


def _summary(manifest: Manifest, aligned: Aligned, count: int, output: Path, out: Console) -> None:
    used = f"{count} of {len(aligned.spoken) + len(aligned.refused)} clips"
    out.print(Text(f"{output} is ready: {manifest.title}, {used}, loop of {manifest.loop_frames / manifest.fps:.1f} s"))
    guessed = sorted({word for each in aligned.spoken for word in each.guessed})
    if guessed:
        more = f" and {len(guessed) - 12} more" if len(guessed) > 12 else ""
        out.print(Text(f"pronunciation guessed: {', '.join(guessed[:12])}{more}"), soft_wrap=True)
    for line in _agreement(aligned):
        out.print(Text(line), soft_wrap=True)
    out.print(Text(f"what was learnt: {output / 'report.html'}"), soft_wrap=True)


def _identity(asked: Asked, output: Path, workspace: Path, err: Console) -> Identity:
    """Who it is: from a file, from the options, or asked for on a terminal. Refused without consent."""
    if asked.identity is not None:
        return read_identity(asked.identity)
    if not asked.subject and not asked.consent:
        for known in (workspace / IDENTITY, output / IDENTITY):
            if known.exists():
                identity = read_identity(known)
                if identity.id != output.name:
                    raise InputError(f"{known} is of {identity.id!r}, the output is {output.name!r}", field="output")
                return identity
    subject, statement = asked.subject, asked.consent
    title = asked.title or output.name.replace("-", " ").replace("_", " ").title()
    if not (subject and statement):
        if not err.is_terminal:
            raise TrainingFailed(
                "an avatar is not made without the consent of the person shown",
                advice="Say who it is and what they agreed to: --subject NAME --consent TEXT, or --identity FILE.",
            )
        subject, statement = _ask(subject, statement, title)
    identity = Identity.model_validate(
        {
            "id": output.name, "title": title, "voice": asked.voice, "licence": asked.licence or "all rights reserved",
            "provenance": "trained from recordings of the person shown",
            "consent": {"subject": subject, "statement": statement},
        }
    )  # fmt: skip
    _made(workspace)
    (workspace / IDENTITY).write_text(_described(identity), encoding="utf-8")
    return identity


def _described(identity: Identity) -> str:
    return json.dumps(identity.model_dump(), indent=2, ensure_ascii=False) + "\n"


def _ask(subject: str, statement: str, title: str) -> tuple[str, str]:
    typer.echo(f"{title} will say whatever anybody types. That needs the consent of the person shown.", err=True)
    subject = subject or typer.prompt("Whose face is it? (full name)", err=True)
    agreed = typer.confirm(f"Has {subject} agreed that this avatar is made and used?", default=False, err=True)
    if not agreed:
        raise TrainingFailed("an avatar is not made without the consent of the person shown")
    usual = f"{subject} agreed that an avatar of their face is made from these recordings and used."
    return subject, statement or typer.prompt("What was agreed, and when?", default=usual, err=True)
