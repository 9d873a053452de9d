"""A recording made ready for learning: every picture's mouth, stabilised, on disk, with the phones that sound."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.engine.background import Box
from app.engine.pack import FPS
from app.engine.training.face_detector import FaceBox
from app.engine.training.face_tracker import FaceTemplate
from app.engine.training.footage import shots
from app.engine.training.frame_store import FrameStore
from app.engine.training.layout import Layout, face_mask, lay_out
from app.engine.training.registration import Correction, register
from app.engine.training.survey import Survey, cut, survey
from app.engine.training.take import Refusal, Take, check_phones, passages, resting
from app.engine.training.workers import in_parallel
from app.engine.training.workspace import Workspace, key
from app.errors import TrainingFailed
from app.speech import Phone

Float = NDArray[np.float32]
Array = NDArray[np.float64]
Progress = Callable[[str, float], None]
"""Told the step's name and the share of it that is done."""

LEAST_SECONDS = 20.0
"""Of usable pictures: from less, no mouth can be learnt."""
CHUNK = 64
"""Pictures cut before they are written."""


@dataclass(frozen=True, slots=True)
class Passage:
    """A stretch of one take between two pauses.

    Attributes:
        take: number of the take.
        frames: in the corpus.
        first: number of its first frame in the take.
    """

    take: int
    frames: range
    first: int


@dataclass(frozen=True)
class Corpus:
    """What a model is learnt from.

    Attributes:
        layout: the geometry.
        takes: those used, in order.
        starts: (takes + 1,) number of each take's first frame in the corpus; last the number of all.
        poses: (T, 2, 3) from reference coordinates to each picture.
        residual: (T,) of the tracker, luma levels.
        good: (T,) which frames may be learnt from.
        rest: (T,) which frames show the mouth at rest.
        passages: in order; together they are all frames.
        corrections: of each passage.
        common: (P,) mean picture at rest, planes flattened.
        frames: (T, P) uint8 crops, planes flattened, stabilised and in one light.
        thumbs: (T, n, n) uint8 tiny luma of whole pictures.
        refused: takes and pictures not used, with the reason.
    """

    layout: Layout
    takes: tuple[Take, ...]
    starts: NDArray[np.int64]
    poses: Array
    residual: Float
    good: NDArray[np.bool_]
    rest: NDArray[np.bool_]
    passages: tuple[Passage, ...]
    corrections: tuple[Correction, ...]
    common: Float
    frames: FrameStore
    thumbs: NDArray[np.uint8]
    refused: tuple[Refusal, ...]

    @property
    def crop(self) -> Box:
        """The mouth region in the reference picture."""
        return self.layout.crop

    @property
    def mask(self) -> Float:
        """(h, w) the mouth mask."""
        return face_mask(self.crop, self.layout.side)

    def phones(self, passage: Passage) -> list[Phone]:
        """Phones of a passage, times from its first frame; the first begins and the last ends with it."""
        start, end = passage.first / FPS, (passage.first + len(passage.frames)) / FPS
        return [
            Phone(phone.symbol, max(phone.start, start) - start, min(phone.end, end) - start)
            for phone in self.takes[passage.take].phones
            if phone.end > start and phone.start < end
        ]


def fingerprint(take: Take) -> list[Any]:
    """What a take is known by: its file's place, size and time, and its phones.

    Raises:
        TrainingFailed: there is no such file.
    """
    phones = [(phone.symbol, round(phone.start, 4), round(phone.end, 4)) for phone in take.phones]
    return [*_file(take), phones]


def _file(take: Take) -> list[Any]:
    try:
        status = take.video.stat()
    except OSError as error:
        raise TrainingFailed(f"{take.name}: {take.video} cannot be read: {error.strerror}") from error
    return [take.name, str(take.video.resolve()), status.st_size, status.st_mtime_ns]


def gather(
    takes: Sequence[Take], workspace: Workspace, *, layout: Layout | None = None, common: Float | None = None,
    progress: Progress, workers: int = 0,
) -> Corpus:  # fmt: skip
    """Find, follow and cut out the face of every take.

    Args:
        takes: with distinct names.
        workspace: keeps what is finished.
        layout, common: of an avatar that exists, to measure it on other takes; found in these takes if not given.
        progress: see `Progress`.
        workers: processes; 0 for one a core.

    Raises:
        TrainingFailed: a file is missing, no take can be used, or they are too short together.
    """
    _check(takes)
    fingerprints = [fingerprint(take) for take in takes]
    given = layout is not None
    progress("finding the face", 0)
    if layout is None:
        files = key([_file(take) for take in takes])
        layout = _layout(workspace.step("layout", files, lambda: _layout_arrays(lay_out(takes)[0])))
    of_layout = key(*_layout_arrays(layout).values())
    keys = [key(of_layout, each) for each in fingerprints]
    surveys, refused = _surveyed(takes, layout, keys, workspace, progress, workers)
    used = sorted(surveys)
    seen = [surveys[number] for number in used]
    seconds = sum(int(each.good.sum()) for each in seen) / FPS
    if not given and seconds < LEAST_SECONDS:
        reasons = "; ".join(f"{each.take}: {each.reason}" for each in refused[:3])
        raise TrainingFailed(
            f"{seconds:.0f} s of usable pictures are too little to learn a mouth from{reasons and f' ({reasons})'}",
            advice=f"Give at least {LEAST_SECONDS:.0f} s; a page read aloud (two minutes and more) is good.",
        )
    rest, rested = (np.concatenate([getattr(each, name) for each in seen]) for name in ("rest", "rested"))
    corrections, common = register(rest, rested, face_mask(layout.crop, layout.side), common=common)
    chosen = tuple(takes[number] for number in used)
    starts = np.concatenate([[0], np.cumsum([each.frames for each in seen])]).astype(np.int64)
    parts = tuple(_passages(chosen, starts))
    poses = np.concatenate([each.poses for each in seen])
    jobs = [
        _Cut(
            take, int(starts[index]), poses[starts[index] : starts[index + 1]],
            tuple((part, corrections[at]) for at, part in enumerate(parts) if part.take == index),
        )
        for index, take in enumerate(chosen)
    ]  # fmt: skip
    of_cuts = key(of_layout, [fingerprints[number] for number in used], rest, rested, common)
    frames = _cut_out(jobs, layout.crop, int(starts[-1]), of_cuts, workspace, progress, workers)
    refused += [refusal for each in seen for refusal in each.refused]
    return Corpus(
        layout=layout, takes=chosen, starts=starts, poses=poses,
        residual=np.concatenate([each.residual for each in seen]),
        good=np.concatenate([each.good for each in seen]),
        rest=np.concatenate([resting(take.phones, each.frames) for take, each in zip(chosen, seen, strict=True)]),
        passages=parts, corrections=tuple(corrections), common=common, frames=frames,
        thumbs=np.concatenate([each.thumbs for each in seen]),
        refused=tuple(sorted(refused, key=lambda each: (each.take, -1 if each.frame is None else each.frame))),
    )  # fmt: skip


def _check(takes: Sequence[Take]) -> None:
    if not takes:
        raise TrainingFailed("there is nothing to learn from")
    name, uses = Counter(take.name for take in takes).most_common(1)[0]
    if uses > 1:
        raise TrainingFailed(f"{uses} takes are called {name}")
    for take in takes:
        check_phones(take.phones, take.name)


def _surveyed(
    takes: Sequence[Take], layout: Layout, keys: Sequence[str], workspace: Workspace, progress: Progress, workers: int
) -> tuple[dict[int, Survey], list[Refusal]]:
    """The surveys of takes, by number: kept ones and new ones; and the takes that cannot be used."""
    surveys: dict[int, Survey] = {}
    refused: list[Refusal] = []
    for number, take in enumerate(takes):
        kept = workspace.kept(f"survey{number}", keys[number])
        if kept is not None:
            surveys[number] = _survey(kept, take.name)
    waiting = [number for number in range(len(takes)) if number not in surveys]
    done = len(surveys)
    results = in_parallel(
        partial(_try_survey, layout=layout), [takes[number] for number in waiting], workers=workers,
        progress=lambda share: progress("following the face", (done + share * len(waiting)) / len(takes)),
    )  # fmt: skip
    for number, result in zip(waiting, results, strict=True):
        if isinstance(result, str):
            refused.append(Refusal(takes[number].name, None, result))
        else:
            surveys[number] = result
            workspace.keep(f"survey{number}", keys[number], _survey_arrays(result))
    return surveys, refused


def _passages(takes: Sequence[Take], starts: NDArray[np.int64]) -> Iterator[Passage]:
    """The passages of all takes, in corpus frames."""
    for index, take in enumerate(takes):
        at = int(starts[index])
        for span in passages(take.phones, int(starts[index + 1]) - at):
            yield Passage(index, range(at + span.start, at + span.stop), span.start)


def _cut_out(
    jobs: Sequence[_Cut], crop: Box, count: int, of_cuts: str, workspace: Workspace, progress: Progress, workers: int
) -> FrameStore:
    """The mouths of all takes, on disk."""

    def fill(store: FrameStore) -> None:
        for _ in in_parallel(
            partial(_cut_take, crop=crop, store=store), jobs, workers=workers,
            progress=lambda share: progress("cutting out the mouth", share),
        ):  # fmt: skip
            pass

    return workspace.store("frames", of_cuts, count, (crop.width * crop.height * 3 // 2,), np.uint8, fill)


def _try_survey(take: Take, layout: Layout) -> Survey | str:
    """A survey, or why there is none: one broken file among good ones stops nothing."""
    try:
        return survey(take, layout)
    except TrainingFailed as error:
        return error.message.removeprefix(f"{take.name}: ")


@dataclass(frozen=True, slots=True)
class _Cut:
    """What to cut out of one take: from corpus frame `start` on, at these poses, passage by passage."""

    take: Take
    start: int
    poses: Array
    parts: tuple[tuple[Passage, Correction], ...]


def _cut_take(job: _Cut, crop: Box, store: FrameStore) -> None:
    size = crop.width * crop.height
    waiting: list[NDArray[np.uint8]] = []
    at = job.start
    parts = list(job.parts)
    for number, shot in enumerate(shots(job.take.video)):
        if number >= len(job.poses):
            break
        while len(parts) > 1 and job.start + number >= parts[0][0].frames.stop:
            parts.pop(0)
        correction = parts[0][1]
        flat = cut(shot.picture, job.poses[number], crop, shift=correction.warp)
        waiting.append(correction.undo(flat, size))
        if len(waiting) == CHUNK:
            store.write(at, np.stack(waiting))
            at += len(waiting)
            waiting.clear()
    if waiting:
        store.write(at, np.stack(waiting))


def _layout_arrays(layout: Layout) -> dict[str, NDArray[Any]]:
    box, crop = layout.template.box, layout.crop
    return {
        "reference": layout.reference,
        "luma": layout.template.luma,
        "face": np.array([box.x, box.y, box.side, layout.template.scale, layout.side]),
        "crop": np.array([crop.x, crop.y, crop.width, crop.height]),
    }


def _layout(stored: dict[str, NDArray[Any]]) -> Layout:
    x, y, tracked_side, scale, side = (float(number) for number in stored["face"])
    template = FaceTemplate(stored["luma"], FaceBox(x, y, tracked_side), scale)
    return Layout(stored["reference"], template, Box(*(int(number) for number in stored["crop"])), side)


def _survey_arrays(seen: Survey) -> dict[str, NDArray[Any]]:
    return {
        "poses": seen.poses, "residual": seen.residual, "good": seen.good, "rest": seen.rest, "rested": seen.rested,
        "thumbs": seen.thumbs,
        "broken": np.array([refusal.frame for refusal in seen.refused], np.int64),
        "reasons": np.array([refusal.reason for refusal in seen.refused], np.str_),
    }  # fmt: skip


def _survey(stored: dict[str, NDArray[Any]], name: str) -> Survey:
    refused = tuple(
        Refusal(name, int(frame), str(reason))
        for frame, reason in zip(stored["broken"], stored["reasons"], strict=True)
    )
    return Survey(
        stored["poses"], stored["residual"], stored["good"], refused, stored["rest"], stored["rested"],
        stored["thumbs"],
    )  # fmt: skip


def without(corpus: Corpus, left_out: Sequence[int]) -> Corpus:
    """The corpus with nothing to learn from these passages (by number): for open tests."""
    good = corpus.good.copy()
    for number in left_out:
        good[list(corpus.passages[number].frames)] = False
    return replace(corpus, good=good)
