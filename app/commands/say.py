"""`mary say`: a text, or a recording with its text, with its phone times, or alone, as an MP4 file."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from app.align import recognisers
from app.align.aligners import Aligners
from app.align.dictionary import read_lexicon
from app.align.given import read_speech
from app.align.listen import align_recording, cut, recognise_recording
from app.align.sound_file import read_sound
from app.config import Settings
from app.engine.avatar import AvatarShelf
from app.engine.background import STILL
from app.engine.pool import OrderedPool
from app.errors import InputError
from app.speech import Speech
from app.stream.clock import FPS
from app.stream.render import render_file
from app.tts.engine import check_configured, choose_voice
from app.tts.narrate import narrate
from app.tts.planning import plan
from app.tts.voicebox import voicebox


@dataclass(frozen=True, slots=True)
class Order:
    """What is to be said, and by whom.

    Attributes:
        text: to be said, or what the recording says; - reads it from standard input.
        audio: a recording to speak with, or None.
        phones: file of its phone times, or None.
        avatar, trajectory, renderer: names; None: those of the settings.
        voice: of the speech engine; None: that of the settings or the avatar.
        speed: 1 is the voice's own pace.
        lexicon: WORD=PHONES each.
        strict: refuse words no dictionary has, or a text that the recording does not say.
        still: keep the head at its rest pose.
    """

    text: str
    audio: Path | None = None
    phones: Path | None = None
    avatar: str | None = None
    trajectory: str | None = None
    renderer: str | None = None
    voice: str | None = None
    speed: float = 1.0
    lexicon: Sequence[str] = ()
    strict: bool = False
    still: bool = False


def run(order: Order, output: Path, settings: Settings, *, out: Console, err: Console) -> None:
    """Render what is ordered, showing progress.

    Args:
        order: see there.
        output: the file.
        settings: of the service.
        out, err: where the result and what is worth knowing go.

    Raises:
        InputError: the order contradicts itself, or the file cannot be written.
        MaryError: what speaking, listening and drawing raise.
    """
    _check(order, output)
    settings = _with_lexicon(settings, order.lexicon)
    with ExitStack() as opened:
        progress = opened.enter_context(_progress(err))
        task = progress.add_task("loading", total=None)
        shelf = AvatarShelf(
            settings.avatars.folder, settings.engine.renderer, settings.avatars.default, settings.engine.trajectory
        )
        face = shelf.get(order.avatar or settings.avatars.default, trajectory=order.trajectory, renderer=order.renderer)
        if face.excuse:
            err.print(Text(face.excuse), soft_wrap=True)
        aligners = opened.enter_context(closing(Aligners(settings.align.aligners)))
        if order.audio is not None and order.phones is not None:
            speeches: Iterator[Speech] = iter([read_speech(order.audio, order.phones)])
        elif order.audio is not None:
            progress.update(task, description="listening")
            speeches = _recorded(order, order.audio, settings, aligners, err)
        else:
            speeches = _spoken(order, settings, face.manifest.voice, aligners, opened, err)
        unread: list[str] = []
        seconds = 0.0

        def counted() -> Iterator[Speech]:
            nonlocal seconds
            for speech in speeches:
                seconds += speech.duration
                unread.extend(speech.unread)
                progress.update(task, description="rendering", total=round(seconds * FPS))
                yield speech

        pool = opened.enter_context(closing(OrderedPool(settings.engine.workers or len(os.sched_getaffinity(0)))))
        try:
            render_file(
                face,
                counted(),
                settings,
                output,
                pool,
                loop_frame=(lambda _: STILL) if order.still else None,
                on_frame=lambda frames: progress.update(task, completed=frames),
            )
        except OSError as error:
            raise InputError(f"{output} cannot be written: {error.strerror or error}", field="output") from error
    if unread:
        err.print(Text(f"left out, cannot be read: {' '.join(dict.fromkeys(unread))}"), soft_wrap=True)
    out.print(Text(f"{output}: {seconds:.1f} s"), soft_wrap=True)


def _check(order: Order, output: Path) -> None:
    if order.audio is None and order.phones is not None:
        raise InputError("--phones are those of a recording", advice="Give --audio, too.")
    if order.audio is None and not order.text:
        raise InputError("give a text or --audio", advice='mary say "Hello" -o hello.mp4')
    if order.phones is not None and order.text:
        raise InputError("give either --phones or a text", advice="The times are found by the text, or given.")
    if output.is_dir() or not output.absolute().parent.is_dir():
        raise InputError(f"{output} cannot be written", field="output", advice="Name a file in a folder that exists.")


def _with_lexicon(settings: Settings, entries: Sequence[str]) -> Settings:
    """The settings with pronunciations of WORD=PHONES put before their own."""
    given = {}
    for entry in entries:
        word, equals, said = entry.partition("=")
        if not equals:
            raise InputError(f"--lexicon takes WORD=PHONES, not {entry!r}", advice='--lexicon "Nguyen=N UW Y EH N"')
        given[word] = said
    read_lexicon(given)
    merged = settings.speech.model_copy(update={"lexicon": {**settings.speech.lexicon, **given}})
    return settings.model_copy(update={"speech": merged})


def _spoken(
    order: Order, settings: Settings, preferred: str, aligners: Aligners, opened: ExitStack, err: Console
) -> Iterator[Speech]:
    """The pieces of a text, each spoken when it is asked for."""
    planned = plan(_whole(order.text), lexicon=settings.speech.lexicon)
    if planned.guessed and order.strict:
        raise InputError(
            f"no dictionary has {', '.join(planned.guessed)}", field="text", advice="Say how with --lexicon."
        )
    if planned.guessed:
        err.print(Text(f"pronounced by guess: {' '.join(planned.guessed)}"), soft_wrap=True)
    engine = opened.enter_context(closing(voicebox(settings.speech, settings.align, aligners).engine))
    check_configured(engine, settings.speech.voice)
    chosen = choose_voice(engine, order.voice or "", settings.speech.voice or preferred)
    engine.warm_up()
    return narrate(engine, planned, voice=chosen.id, speed=order.speed)


def _recorded(order: Order, audio: Path, settings: Settings, aligners: Aligners, err: Console) -> Iterator[Speech]:
    """The pieces of a recording, its phones found by its text, or heard."""
    said = _whole(order.text)
    samples, rate = read_sound(audio, longest=settings.limits.audio_seconds)
    if not said.strip():
        return cut(recognise_recording(samples, rate, recognisers.create(settings.align.recogniser)).speech)
    own = read_lexicon(settings.speech.lexicon)
    aligner = aligners.get(settings.align.engine)
    listened = align_recording(samples, rate, said, aligner, strict=order.strict, lexicon=own)
    if listened.guessed:
        err.print(Text(f"pronounced by guess: {' '.join(listened.guessed)}"), soft_wrap=True)
    if listened.doubtful:
        doubt = f"the text does not seem to be what is said (confidence {listened.confidence:.2f})"
        err.print(Text(doubt), soft_wrap=True)
    return cut(listened.speech)


def _whole(text: str) -> str:
    return sys.stdin.read() if text == "-" else text


def _progress(err: Console) -> Progress:
    """A bar while something long goes on; it is gone afterwards."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=err, transient=True, disable=not err.is_terminal)
