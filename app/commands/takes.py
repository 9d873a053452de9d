"""From video files and transcripts to takes: what `mary train` and `mary evaluate` begin with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from app.align.align_clips import Aligned, align_clips
from app.align.clip_sound import read_clip_sound
from app.align.clips import Clip
from app.align.registry import create
from app.engine.models.sound import Sound
from app.engine.training.take import Take
from app.engine.training.workers import cores
from app.errors import InputError


def spoken_takes(
    clips: Sequence[Clip],
    *,
    aligner: str,
    cache: Path | None,
    workers: int,
    progress: Callable[[float], None],
) -> tuple[list[Take], Aligned]:
    """Find when the phones of clips sound.

    Args:
        clips: as `app.align.clips.find_clips` finds them.
        aligner: its name (`app.align.registry`).
        cache: folder that keeps alignments, or None.
        workers: aligners at once; 0 for one a core.
        progress: told the share done.

    Returns:
        a take for every clip that can be used, and what became of all clips.

    Raises:
        InputError: no clip can be used.
        NotFound, MissingExtra: the aligner.
    """
    count = workers or cores()
    aligned = align_clips(clips, lambda: create(aligner), cache=cache, workers=count, progress=progress)
    if not aligned.spoken:
        first = aligned.refused[0]
        more = f" (and {len(aligned.refused) - 1} more clips)" if len(aligned.refused) > 1 else ""
        raise InputError(f"{first.clip.name}: {first.reason}{more}", advice=first.advice)
    return [Take(each.clip.name, each.clip.video, each.phones) for each in aligned.spoken], aligned


def hear(take: Take) -> Sound:
    """The sound of a take, on the clock of its picture.

    Raises:
        InputError: it has none that can be read.
    """
    sound = read_clip_sound(take.video)
    return Sound(sound.samples, sound.rate)
