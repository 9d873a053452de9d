"""Forced alignment by CMU's pocketsphinx, in a process of its own.

Chosen because its acoustic model and dictionary come in its wheel (BSD) and it needs three hundredths of the sound's
length on one core. It holds Python's global lock while it works, so it gets a process (`app.align.sphinx_worker`),
which is also killed when it takes too long and replaced when it dies.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np
import soxr
from numpy.typing import NDArray

from app.align.aligner import Alignment, assemble, checked
from app.align.dictionary import NO_LEXICON, Dictionary, Lexicon, WrittenWord
from app.align.pauses import close_gaps, trim
from app.align.phoneset import Sound
from app.errors import AlignmentFailed, NothingToSay
from app.speech import PHONES, SILENCE
from app.worker import Worker, WorkerFailed

RATE = 16_000  # samples a second, of the acoustic model
FRAME = 0.010  # 10 ms: the grid of its times
PADDING = 0.2  # seconds of faint noise at both ends: without it sentences that begin at once are lost
NOISE = 8  # of 32,768: peak of the padding
SHIFT = 0.011  # 11 ms: its times are this early, against speech of exactly known times
LEAST_SECONDS = 0.1

LONGEST = 90.0  # seconds aligned at once (0.4 GB); longer sound is cut at pauses
WINDOW = 60.0  # seconds listened to for finding the next pause to cut at
FASTEST = 6.0  # words a second that a window may have
LONG_PAUSE = 0.5  # seconds: surely a pause

START_LIMIT = 30.0  # seconds for the process to start and answer, whatever is asked of it
LIMIT_PER_SECOND = 1.0  # and this for each second of sound; it needs 0.03

HALFWAY = 49.0  # misfit between those of right transcripts and of wrong ones: confidence 0.5
WORST = 110.0  # misfit of one phone is counted up to this: one short slip among many phones is no other text
STEEPNESS = 5.0  # of misfit that takes confidence from 0.5 to 0.27


@dataclass(frozen=True, slots=True)
class _Scored:
    """A phone with its acoustic score a frame (0: the best sound there is, more negative: less like it)."""

    sound: Sound
    score: float


class PocketSphinxAligner:
    """See `app.align.aligner.Aligner`. English.

    One call at a time goes to the process, others wait; make several aligners to use several cores. The process starts
    with the first call (or `warm_up`) and ends with `close`, with the aligner, or with this process.

    The confidence comes from the phones' scores a frame, which say how much less likely the phone is there than the
    best one: their root mean square tells wrong transcripts better than their mean, because it minds the few words that
    do not fit. See docs/speech.md for what it is on right and wrong transcripts.

    Args:
        dictionary: pronounces the words; a plain `Dictionary` if none is given.
        time_limit: seconds for one request to the process (sound longer than `LONGEST` takes several); in proportion to
            the sound if none is given.
        shift: seconds by which its times are taken to be early; 0 to measure that.
    """

    name = "pocketsphinx"

    def __init__(
        self, dictionary: Dictionary | None = None, *, time_limit: float | None = None, shift: float = SHIFT
    ) -> None:
        self._dictionary = dictionary or Dictionary()
        self._shift = shift
        self.time_limit = time_limit
        self._worker = Worker("app.align.sphinx_worker")

    def warm_up(self) -> None:
        """Load the dictionary and start the process."""
        self._dictionary.word("hello")
        self._ask("hello", [], np.zeros(0, np.float32))

    def align(self, samples: NDArray[np.float32], rate: int, text: str, *, lexicon: Lexicon = NO_LEXICON) -> Alignment:
        checked(samples, rate, text)
        words = self._dictionary.with_lexicon(lexicon).read(text)
        numbers = [number for number, word in enumerate(words) if word.pronunciations]
        if not numbers:
            raise NothingToSay("the transcript has no word that sounds", field="text")
        duration = len(samples) / rate
        if duration < LEAST_SECONDS:
            raise self._failed(f"{duration * 1000:.0f} ms of sound are too short to align")
        sound = samples if rate == RATE else soxr.resample(samples, rate, RATE)
        scored = [
            phone
            for start, end, part in self._parts(sound, [words[number] for number in numbers])
            for phone in self._aligned(sound[start:end], start / RATE, words, numbers[part.start : part.stop])
        ]
        spoken = [phone.score for phone in scored if phone.sound.symbol != SILENCE]
        sounds = _gapless(scored, duration)
        if all(each.symbol == SILENCE for each in sounds):
            raise self._unsaid(0.0, duration, [word.text for word in words])
        sounds = trim(close_gaps(sounds), sound, RATE)
        return assemble(
            sounds,
            [word.text for word in words],
            duration,
            guessed=[word.text for word in words if word.guessed],
            confidence=_confidence(spoken),
        )

    def close(self) -> None:
        """End the process; a call under way in another thread fails at once, the next one starts a new process."""
        self._worker.close()

    def __enter__(self) -> PocketSphinxAligner:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    @property
    def process(self) -> int | None:
        """Number of the process that is at work or waiting for it; None if there is none."""
        return self._worker.pid

    # --- what is asked of the process

    def _aligned(
        self, sound: NDArray[np.float32], origin: float, words: Sequence[WrittenWord], numbers: Sequence[int]
    ) -> Iterator[_Scored]:
        """Phones of one piece of sound that begins at `origin` seconds and says the words of these numbers."""
        answer = self._ask("align", [words[number] for number in numbers], sound)
        if answer is None:
            raise self._unsaid(origin, len(sound) / RATE, [words[number].text for number in numbers])
        end = origin + len(sound) / RATE
        for word, phone, first, frames, score in answer:
            known = phone in PHONES and word >= 0
            begins = min(max(origin + first * FRAME - PADDING + self._shift, origin), end)
            ends = min(max(origin + (first + frames) * FRAME - PADDING + self._shift, origin), end)
            sounding = Sound(phone if known else SILENCE, begins, ends, numbers[word] if known else -1)
            yield _Scored(sounding, score / max(frames, 1))

    def _parts(self, sound: NDArray[np.float32], words: Sequence[WrittenWord]) -> Iterator[tuple[int, int, range]]:
        """Cut long sound at pauses: (first sample, last, words said in between) of each piece.

        Each window is laid beside the beginning of the words still to come, any number of them, and is cut at the
        longest pause in its second half, so that the words that its end breaks off are heard whole in the next. Windows
        without speech are passed over.
        """
        start, first = 0, 0
        while len(sound) - start > LONGEST * RATE and first < len(words):
            window = sound[start : start + round(WINDOW * RATE)]
            answer = self._ask("begin", words[first : first + round(WINDOW * FASTEST)], window)
            heard = [] if answer is None else [_times(each) for each in answer]
            if first + len(heard) == len(words) and heard[-1][1] < WINDOW - 1.0:  # all is said, the rest is silent
                break
            if len(heard) < 2:
                start += round(WINDOW / 2 * RATE)
                continue
            count, cut = _cut(heard)
            yield start, start + round(cut * RATE), range(first, first + count)
            start, first = start + round(cut * RATE), first + count
        if first < len(words):
            yield start, min(start + round(LONGEST * RATE), len(sound)), range(first, len(words))

    def _ask(self, task: str, words: Sequence[WrittenWord], sound: NDArray[np.float32]) -> Any:
        question = {"task": task, "words": [[" ".join(said) for said in word.pronunciations] for word in words]}
        limit = self.time_limit
        if limit is None:
            limit = START_LIMIT + LIMIT_PER_SECOND * len(sound) / RATE
        try:
            answer, _ = self._worker.ask(question, _padded(sound), seconds=limit)
        except WorkerFailed as failure:
            advice = "Try again; if that fails too, try a shorter recording."
            raise self._failed(str(failure), advice=advice) from failure
        return answer

    def _unsaid(self, origin: float, duration: float, words: Sequence[str]) -> AlignmentFailed:
        return self._failed(f"the {duration:.1f} s of sound from {origin:.1f} s on do not say “{_excerpt(words)}”")

    def _failed(self, message: str, advice: str = "Is the text that which is said?") -> AlignmentFailed:
        return AlignmentFailed(f"aligner {self.name}: {message}", advice=advice)


def _padded(sound: NDArray[np.float32]) -> bytes:
    """16-bit samples with faint noise at both ends, the same noise every time."""
    generator = np.random.default_rng(0)
    rest = [generator.integers(-NOISE, NOISE + 1, round(PADDING * RATE)).astype("<i2") for _ in range(2)]
    return np.concatenate([rest[0], np.round(np.clip(sound, -1.0, 1.0) * 32767).astype("<i2"), rest[1]]).tobytes()


def _gapless(scored: Sequence[_Scored], duration: float) -> list[Sound]:
    """The phones with silence wherever there is none; neighbouring silences are one."""
    sounds: list[Sound] = []
    at = 0.0
    for sound in [phone.sound for phone in scored if phone.sound.symbol != SILENCE]:
        start, end = max(at, sound.start), max(at, sound.end)
        if start > at:
            sounds.append(Sound(SILENCE, at, start))
        if end > start:
            sounds.append(Sound(sound.symbol, start, end, sound.word))
        at = max(at, end)
    return [*sounds, Sound(SILENCE, at, duration)] if at < duration else sounds


def _times(heard: Sequence[int]) -> tuple[float, float]:
    _, first, frames = heard
    return first * FRAME - PADDING, (first + frames) * FRAME - PADDING


def _cut(heard: Sequence[tuple[float, float]]) -> tuple[int, float]:
    """Where to cut a window: the number of words before it, and the time (seconds from its beginning).

    At the first long pause in its second half: the word after it may already be one that is not said in it at all. Else
    at the longest of the short pauses there but for the last tenth, where words may be pressed together.
    """
    starts = [*(start for start, _ in heard[1:]), WINDOW]
    gaps = [(start - end, count) for count, ((_, end), start) in enumerate(zip(heard, starts, strict=True), 1)]
    later = [gap for gap, start in zip(gaps, starts, strict=True) if start > WINDOW / 2]
    long = [gap for gap in later if gap[0] >= LONG_PAUSE]
    certain = gaps[: -max(1, len(gaps) // 10)]
    _, count = long[0] if long else max([gap for gap in later if gap in certain] or certain)
    return count, (heard[count - 1][1] + starts[count - 1]) / 2


def _confidence(scores: Sequence[float]) -> float:
    if not scores:
        return 0.0
    misfit = math.sqrt(math.fsum(min(-score, WORST) ** 2 for score in scores) / len(scores))
    return 1 / (1 + math.exp(min((misfit - HALFWAY) / STEEPNESS, 700.0)))


def _excerpt(words: Sequence[str], longest: int = 60) -> str:
    text = " ".join(words)
    return text if len(text) <= longest else text[: longest - 1].rstrip() + "…"
