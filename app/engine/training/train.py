"""From takes to an avatar pack (Fu 2011, 3.1; the serving form after `app.engine.modes`)."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

from app.engine.frame import to_rgb
from app.engine.modes import ModeMouth
from app.engine.pack import (
    FILES,
    FPS,
    IDLE,
    LOOP,
    MANIFEST,
    MODEL,
    MODELS,
    PREVIEW,
    Manifest,
    Pack,
    checksums,
    digest,
    load_pack,
    save_model,
    write_manifest,
)  # fmt: skip
from app.engine.selection_library import NAME as SELECTION
from app.engine.stored_arrays import MOST_BYTES
from app.engine.threads import one_thread_a_call
from app.engine.training.appearance import Appearance, learn_appearance
from app.engine.training.articulation import Articulation, learn_articulation, spoken_passages
from app.engine.training.background_loop import LoopPicture, bake_loop, crop_warp, loop_pictures
from app.engine.training.corpus import Corpus, Progress, gather, without
from app.engine.training.footage import shots
from app.engine.training.further_models import Hear, check_further, heard_passages, train_further
from app.engine.training.identity import Identity
from app.engine.training.layout import Layout
from app.engine.training.registration import UNCORRECTED
from app.engine.training.selection_samples import write_samples
from app.engine.training.stretches import LONGEST, Mixed, Stretch, choose_stretches, joined
from app.engine.training.survey import survey
from app.engine.training.take import Take
from app.engine.training.workspace import Workspace
from app.engine.training.write_clips import write_idle, write_loop
from app.errors import TrainingFailed, TrainingStopped
from app.speech import SILENCE, Phone


@dataclass(frozen=True)
class Learnt:
    """Everything that training learns from takes.

    Attributes:
        corpus: the takes made ready.
        appearance: what the mouth looks like.
        articulation: how it moves.
    """

    corpus: Corpus
    appearance: Appearance
    articulation: Articulation


def silent_progress(step: str, share: float) -> None:
    """Tell nobody."""


def learn(
    takes: Sequence[Take],
    workspace: Workspace,
    *,
    leave_out: Collection[int] = (),
    seed: int = 0,
    workers: int = 0,
    progress: Progress = silent_progress,
) -> Learnt:
    """Learn a talker.

    Args:
        takes: what to learn from.
        workspace: keeps finished steps.
        leave_out: numbers of passages whose mouths nothing is learnt from: for open tests on one long take. (Where the
            face is, is found on the whole take; clips to be left out are better not given at all.)
        seed: of everything random; the same seed gives the same model.
        workers: processes; 0 for one a core.
        progress: see `Progress`.

    Raises:
        TrainingFailed: the takes cannot be learnt from; says why.
    """
    one_thread_a_call()  # threads would add up in another order, and the same seed would choose other prototypes
    corpus = gather(takes, workspace, progress=progress, workers=workers)
    unknown = [number for number in leave_out if not 0 <= number < len(corpus.passages)]
    if unknown:
        raise TrainingFailed(f"there is no sentence {unknown[0]}; the recording has {len(corpus.passages)}")
    corpus = without(corpus, sorted(leave_out))
    if not corpus.good.any():
        raise TrainingFailed("nothing is left to learn from")
    appearance = learn_appearance(corpus, workspace, seed=seed, progress=progress, workers=workers)
    spoken = spoken_passages(corpus, appearance.coefficients, appearance.rest)
    articulation = learn_articulation(
        spoken, appearance.rest, seed=seed, progress=lambda share: progress("trajectories", share)
    )  # fmt: skip
    return Learnt(corpus, appearance, articulation)


def train(
    takes: Sequence[Take],
    identity: Identity,
    output: Path,
    *,
    background: Path | None = None,
    leave_out: Collection[int] = (),
    models: Sequence[str] = (),
    hear: Hear | None = None,
    seed: int = 0,
    workers: int = 0,
    progress: Progress = silent_progress,
    extras: Callable[[Learnt, Pack, Path], None] = lambda *_: None,
) -> Manifest:
    """Train an avatar and write its pack.

    Args:
        takes: what to learn from.
        identity: who it is.
        output: the pack's folder; its files are replaced when everything is done, and untouched if anything fails.
        background: a video of the same head moving, mouth at rest, whose last picture is followed by its first; without
            one, the loop is joined from stretches of the takes.
        leave_out, seed, workers: see `learn`.
        models: trajectory models to train besides the Gaussians, by name; "selection": samples for that renderer.
        hear: gives the sound of takes, which some of these need.
        progress: see `Progress`.
        extras: called with what was learnt, the finished pack and its folder: writes what belongs beside it.

    Raises:
        NotFound, MissingExtra: one of `models`.
        TrainingFailed: the takes cannot be learnt from.
        TrainingStopped: the output cannot be written, or a process was killed.
    """
    kinds = check_further(models)
    workspace = Workspace(workspace_of(output))
    learnt = learn(
        takes, workspace, leave_out=leave_out, seed=seed, workers=workers,
        progress=progress,
    )  # fmt: skip
    corpus, appearance = learnt.corpus, learnt.appearance
    loop = _given_loop(background, corpus.layout) if background else _joined_loop(corpus, appearance)
    modes, baked = bake_loop(
        loop.shown, loop.mixed, corpus.layout.reference, appearance.modes, appearance.rest, corpus.common, corpus.crop,
        corpus.mask, ModeMouth, all_at_rest=background is not None,
        progress=lambda share: progress("background", share),
    )  # fmt: skip
    progress("writing", 0)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{output.name}-", dir=output.parent))
    except OSError as error:
        raise _unwritten(output, error) from error
    try:
        save_model(draft / MODEL, modes, appearance.morphable, learnt.articulation.model, baked)
        if kinds:
            spoken = heard_passages(corpus, appearance.coefficients, appearance.rest, hear)
            train_further(kinds, spoken, appearance.rest, draft, workspace, seed=seed, progress=progress, mouths=modes)
        if SELECTION in models:
            write_samples(
                draft, corpus, appearance.coefficients, modes, appearance.rest, baked, seed=seed,
                progress=lambda share: progress("samples", share),
            )  # fmt: skip
        write_loop(draft / LOOP, baked.pictures, FPS)
        write_idle(draft / IDLE, baked.pictures[:-1], FPS)
        preview = to_rgb(baked.pictures[0])[..., ::-1]
        if not cv2.imwrite(str(draft / PREVIEW), preview, [cv2.IMWRITE_JPEG_QUALITY, 92]):
            raise TrainingStopped(f"{draft / PREVIEW} could not be written")
        width, height = corpus.layout.size
        manifest = Manifest(
            format=1, fps=FPS, width=width, height=height, loop_frames=baked.frames, files=checksums(draft),
            trained_on=tuple(_digests(corpus)), **identity.model_dump(),
        )  # fmt: skip
        write_manifest(draft, manifest)
        extras(learnt, load_pack(draft), draft)
        _replace(draft, output)
    except OSError as error:
        raise _unwritten(output, error) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    workspace.remove()
    return manifest


def _unwritten(output: Path, error: OSError) -> TrainingStopped:
    return TrainingStopped(
        f"{output} cannot be written: {error.strerror or error}",
        advice="Make room on the disk and run the same command again: the finished steps are kept.",
    )


def workspace_of(output: Path) -> Path:
    """Where the steps of training an avatar into `output` are kept until it is finished."""
    return output.parent / f".{output.name}.training"


SILENT = 3600.0
"""Seconds: longer than any loop that is given."""


@dataclass(frozen=True)
class _Loop:
    """What a loop is made from; see `bake_loop`."""

    shown: Callable[[], Iterator[tuple[int, LoopPicture]]]
    mixed: Mixed


def most_frames(layout: Layout) -> int:
    """Pictures that a loop may have: all of them lie in memory."""
    width, height = layout.size
    return min(round(LONGEST * FPS), MOST_BYTES // (width * height * 3 // 2) - 2)


def plan_loop(corpus: Corpus) -> tuple[list[Stretch], Mixed]:
    """The stretches of a corpus that its loop goes through, and what each of the loop's pictures is mixed from.

    Raises:
        TrainingFailed: no clip that is learnt from is of the reference picture's size.
    """
    usable = without(corpus, list(_of_other_size(corpus)))
    if not usable.good.any():
        raise TrainingFailed("no clip that is learnt from is of the size of the first, which the loop is to have")
    stretches = choose_stretches(usable, most=most_frames(corpus.layout))
    return stretches, joined(stretches, usable)


def _joined_loop(corpus: Corpus, appearance: Appearance) -> _Loop:
    _, mixed = plan_loop(corpus)
    return _Loop(lambda: loop_pictures(corpus, appearance.coefficients, mixed), mixed)


def _of_other_size(corpus: Corpus) -> Iterator[int]:
    """Numbers of passages whose pictures are not of the size of the reference."""
    shapes = [next(shots(take.video)).picture.shape for take in corpus.takes]
    for number, passage in enumerate(corpus.passages):
        if shapes[passage.take] != corpus.layout.reference.shape:
            yield number


def _given_loop(video: Path, layout: Layout) -> _Loop:
    seen = survey(Take(video.name, video, (Phone(SILENCE, 0.0, SILENT),)), layout)
    if not seen.good.all():
        first = seen.refused[0]
        raise TrainingFailed(f"{video.name}: picture {first.frame}: {first.reason}")
    most = most_frames(layout)
    if seen.frames > most:
        raise TrainingFailed(f"{video.name} has {seen.frames} pictures, a loop of this size has at most {most}")

    def shown() -> Iterator[tuple[int, LoopPicture]]:
        for number, shot in enumerate(shots(video)):
            warp = crop_warp(seen.poses[number], layout.crop, UNCORRECTED)
            yield number, LoopPicture(shot.picture, warp, UNCORRECTED, None)

    return _Loop(shown, [[(number, 1.0)] for number in range(seen.frames)])


def _digests(corpus: Corpus) -> Iterator[str]:
    """SHA-256 of every take's file that something was learnt from."""
    for index, take in enumerate(corpus.takes):
        if corpus.good[corpus.starts[index] : corpus.starts[index + 1]].any():
            yield digest(take.video)


def _replace(draft: Path, output: Path) -> None:
    """Move a finished pack to where it belongs, its manifest last; other files of the folder stay.

    Models of an earlier training go: they were trained for its mouths.
    """
    output.mkdir(exist_ok=True)
    shutil.rmtree(output / MODELS, ignore_errors=True)
    others = [path.name for path in draft.iterdir() if path.name not in (*FILES, MANIFEST)]
    for name in (*others, *FILES, MANIFEST):
        (draft / name).replace(output / name)
