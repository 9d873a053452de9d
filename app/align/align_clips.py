"""Phones for all clips of a corpus: in parallel, with a cache, and with a reason for each clip that cannot be used."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from app.align.aligner import DOUBTFUL, Aligner, Alignment
from app.align.alignment_cache import AlignmentCache, Entry
from app.align.clip_sound import ClipSound, read_clip_sound
from app.align.clips import Clip
from app.align.transcript import Transcript, read_transcript
from app.errors import AlignmentFailed, InputError, MaryError
from app.speech import Phone, Word

END_LIMIT = 5.0  # seconds that the threads may take to end when a run is broken off; they end with Mary anyway

END_STEP = 0.1  # seconds between attempts to end them


@dataclass(frozen=True, slots=True)
class SpokenClip:
    """A clip and when its phones and words sound: seconds on the video's clock, 0 is its first picture.

    Attributes:
        clip: the clip.
        phones: gapless ARPAbet from 0 to the end of the sound, silences included.
        words: as they are written, in order of time; gaps are allowed.
        guessed: written words whose pronunciation is not from a dictionary.
        confidence: 0 to 1, how well the sound fits the text; 1 for times taken from the transcript.
        given: the words with the transcript's own times, moved to the video's clock; None if it has none.
        aligner: name of the aligner; "" if the phones are the transcript's own.
    """

    clip: Clip
    phones: tuple[Phone, ...]
    words: tuple[Word, ...]
    guessed: tuple[str, ...]
    confidence: float
    given: tuple[Word, ...] | None
    aligner: str


@dataclass(frozen=True, slots=True)
class Refused:
    """A clip that cannot be used.

    Attributes:
        clip: the clip.
        reason: what is wrong with it, in one sentence without a full stop.
        advice: what to do about it.
    """

    clip: Clip
    reason: str
    advice: str = ""


@dataclass(frozen=True, slots=True)
class Aligned:
    """What became of the clips of a corpus; both in their order."""

    spoken: tuple[SpokenClip, ...]
    refused: tuple[Refused, ...]


def align_clips(
    clips: Sequence[Clip],
    make_aligner: Callable[[], Aligner],
    *,
    cache: Path | None = None,
    workers: int = 1,
    progress: Callable[[float], None] = lambda _: None,
) -> Aligned:
    """Find the phones of all clips.

    Times in transcripts count from the first sample of the sound, as the programs heard it that found them, and are
    moved to the video's clock. A transcript with phone times is taken at its word; an aligner finds the others. The
    result is the same for any number of workers.

    Args:
        clips: as `app.align.clips.find_clips` finds them.
        make_aligner: a new aligner; called once in each thread that needs one. Its `close`, if it has one, is called
            at the end, and from another thread while it is at work if the run is broken off.
        cache: folder for alignments once found; None keeps nothing. See `AlignmentCache`.
        workers: threads, each with an aligner of its own.
        progress: called in this thread with the share of clips that are done, 0 to 1; what it raises ends the run.

    Raises:
        NotFound, MissingExtra, AlignmentFailed: from `make_aligner`.
        InputError: the cache's folder cannot be made.
        KeyboardInterrupt: after the threads and their aligners have ended.
    """
    kept = AlignmentCache(cache) if cache is not None else None
    run = _Run(clips, make_aligner, kept)
    threads = [
        threading.Thread(target=run.work, name=f"align-clips-{number}", daemon=True)
        for number in range(max(1, min(workers, len(clips))))
    ]
    results: list[SpokenClip | Refused | None] = [None] * len(clips)
    try:
        for thread in threads:
            thread.start()
        for done in range(len(clips)):
            answer = run.done.get()
            if isinstance(answer, BaseException):
                raise answer
            number, results[number] = answer
            progress((done + 1) / len(clips))
    finally:
        run.end([thread for thread in threads if thread.ident is not None])
    return Aligned(
        tuple(result for result in results if isinstance(result, SpokenClip)),
        tuple(result for result in results if isinstance(result, Refused)),
    )


class _Run:
    """The work that threads share.

    Attributes:
        done: number of a clip and what became of it, or what stopped a thread.
    """

    def __init__(
        self, clips: Sequence[Clip], make_aligner: Callable[[], Aligner], cache: AlignmentCache | None
    ) -> None:
        self.done: queue.SimpleQueue[tuple[int, SpokenClip | Refused] | BaseException] = queue.SimpleQueue()
        self._clips = clips
        self._numbers = iter(range(len(clips)))
        self._make_aligner = make_aligner
        self._cache = cache
        self._lock = threading.Lock()
        self._ended = False
        self._aligners: list[Aligner] = []

    def work(self) -> None:
        """Take one clip after the other until there are no more, or the run is ended."""
        aligner: Aligner | None = None

        def lend() -> Aligner:
            nonlocal aligner
            aligner = aligner or self._aligner()
            return aligner

        try:
            for number in self._next():
                self.done.put((number, _result(self._clips[number], lend, self._cache)))
        except _Ended:
            pass
        except BaseException as error:
            self.done.put(error)

    def end(self, threads: Sequence[threading.Thread]) -> None:
        """No clip is begun any more, the aligners are closed, and the threads have ended, or soon will.

        A thread may turn to its aligner just after that was closed, so they are closed until all threads are gone.
        """
        with self._lock:
            self._ended = True
        limit = time.monotonic() + END_LIMIT
        alive = list(threads)
        while alive and time.monotonic() < limit:
            self._close()
            alive[0].join(END_STEP)
            alive = [thread for thread in alive if thread.is_alive()]
        self._close()

    def _close(self) -> None:
        for aligner in self._aligners:
            if callable(close := getattr(aligner, "close", None)):
                close()

    def _next(self) -> Iterator[int]:
        while True:
            with self._lock:
                number = None if self._ended else next(self._numbers, None)
            if number is None:
                return
            yield number

    def _aligner(self) -> Aligner:
        with self._lock:  # none is made behind the back of `end`
            if self._ended:
                raise _Ended
            self._aligners.append(self._make_aligner())
            return self._aligners[-1]


class _Ended(Exception):
    """The run is over."""


def _result(clip: Clip, lend: Callable[[], Aligner], cache: AlignmentCache | None) -> SpokenClip | Refused:
    """What becomes of a clip; `lend` gives the aligner if one is needed."""
    if clip.transcript is None:
        return Refused(clip, "it has no transcript", "Put a text file with the same name beside it.")
    try:
        transcript = Transcript(clip.text) if clip.text is not None else read_transcript(clip.transcript)
    except InputError as error:
        return Refused(clip, error.message, error.advice)
    aligner = lend() if transcript.phones is None else None
    name = aligner.name if aligner else ""
    try:
        clip.video.open("rb").close()
        key = cache.key(clip, name) if cache else ""
        entry = cache.read(key) if cache else None
        if entry is None:
            entry = _entry(clip.video, transcript, aligner)
            if cache:
                cache.write(key, entry)
    except OSError as error:
        return Refused(clip, f"{clip.video.name} cannot be read: {error.strerror or error}")
    except MaryError as error:
        return Refused(clip, error.message, error.advice)
    found = entry.alignment
    if found.confidence < DOUBTFUL:
        missing = f" {entry.lost:.1f} s of its sound are missing or damaged." if entry.lost else ""
        return Refused(
            clip,
            f"the transcript does not fit what is said (confidence {found.confidence:.2f})",
            f"Is {clip.transcript.name} what is said in {clip.video.name}?{missing}",
        )
    given = _moved_words(transcript.words, entry.start) if transcript.words else None
    return SpokenClip(clip, found.phones, found.words, found.guessed, found.confidence, given, name)


def _entry(video: Path, transcript: Transcript, aligner: Aligner | None) -> Entry:
    """An alignment on the video's clock: the aligner's, or without one the transcript's own."""
    sound = read_clip_sound(video)
    if aligner is None:
        assert transcript.phones is not None
        phones = tuple(
            Phone(each.symbol, each.start + sound.start, each.end + sound.start) for each in transcript.phones
        )
        words = _moved_words(transcript.words or (), sound.start)
        found = replace(transcript, phones=phones, words=words).alignment(sound.duration)
    else:
        found = _aligned(aligner, sound, transcript.text)
    return Entry(found, sound.start, sound.lost)


def _aligned(aligner: Aligner, sound: ClipSound, text: str) -> Alignment:
    try:
        return aligner.align(sound.samples, sound.rate, text)
    except MaryError:
        raise
    except Exception as error:  # whatever another package's aligner raises: it is about this clip only
        raise AlignmentFailed(f"aligner {aligner.name}: {type(error).__name__}: {error}") from error


def _moved_words(words: Sequence[Word], by: float) -> tuple[Word, ...]:
    """Words so many seconds later; what is before 0 then is cut off."""
    return tuple(Word(word.text, max(word.start + by, 0.0), word.end + by) for word in words if word.end + by > 0)
