"""Sees to it that speech has phone times: the engine's own where there are some, else those an aligner finds."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.align.aligner import Aligner
from app.align.dictionary import NO_LEXICON, Lexicon
from app.align.phone_agreement import start_differences
from app.errors import AlignmentFailed, MaryError, SpeechFailed
from app.speech import Speech
from app.tts.engine import SpeechEngine, Voice
from app.tts.limit import Limit, remaining
from app.tts.narrate import check

AUTO, NATIVE = "auto", "native"
"""Choices beside an aligner's name: the engine's own times if they are there and sound, else the aligner's; never the
aligner's."""

QUIETEST = 1e-4
"""Peak of sound that is none: -80 dB, three steps of 16 bits, which encoders make of silence."""
FOREIGN = 0.02
"""An aligner's confidence under this, over a few words, in sound as steady as `STEADY` (it is noise) or with times that
cannot be (a wrong sample rate, say): it does not say the text. The confidence alone does not tell: of espeak's voices
at 8 kHz, which people understand, 7 to 45 % of the sentences are under it, down to 0.0002; white and pink noise reaches
0.005 (60 sentences, 20 noises)."""
FEW_WORDS = 3
STEADY = 4.0
"""Decibels by which the level of 20 ms of sound differs from its mean (standard deviation): noise has 0.3, speech 13
and more."""

CHECK_FIRST, CHECK_EVERY = 20, 200
"""Which of an engine's sentences are laid beside the aligner's times: not the first, in which somebody waits."""
CHECK_DELAY = 3.0
"""Seconds after a sentence before it is checked: the first pictures of it come first."""
APART = 0.040
"""Seconds (one picture) between the two, in the median, from which on they disagree."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class TimesCount:
    """Sentences so far.

    Attributes:
        native: with the engine's own times.
        aligned: with an aligner's.
        unsound: whose own times were refused.
        unaligned: that no aligner could align.
        checked: whose own times were laid beside an aligner's.
        disagreed: of these, those whose median lay more than `APART` away.
    """

    native: int = 0
    aligned: int = 0
    unsound: int = 0
    unaligned: int = 0
    checked: int = 0
    disagreed: int = 0


class TimedEngine:
    """An engine all of whose speech has phones and words. Safe from any thread.

    Now and then, in the background, the engine's own times are laid beside the aligner's; whether they agree is logged
    and counted.

    Args:
        engine: speaks, with times or without.
        choice: `AUTO`, `NATIVE`, or anything else: always the aligner.
        aligner: makes it, when it is first needed.
        limit: of the sentence; what speaking leaves of it is the aligner's.

    Attributes:
        count: see `TimesCount`.
    """

    def __init__(self, engine: SpeechEngine, choice: str, aligner: Callable[[], Aligner], limit: Limit) -> None:
        self.name = engine.name
        self.pronounces = engine.pronounces
        self.count = TimesCount()
        self._engine = engine
        self._choice = choice
        self._aligner = aligner
        self._limit = limit
        self._lock = threading.Lock()
        self._checking = threading.Lock()

    def voices(self) -> tuple[Voice, ...]:
        return self._engine.voices()

    def warm_up(self) -> None:
        """The engine, and the aligner if it will be needed."""
        self._engine.warm_up()
        if self._choice not in (AUTO, NATIVE):
            _warm(self._aligner())

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        began = time.monotonic()
        speech = self._engine.speak(text, voice=voice, speed=speed, lexicon=lexicon)
        said = lexicon if self.pronounces else NO_LEXICON
        heard(speech, self.name)
        if not speech.phones or self._choice not in (AUTO, NATIVE):
            return self._aligned(speech, text, said, began)
        try:
            check(speech, self.name)
        except SpeechFailed as error:
            self._add(unsound=1)
            if self._choice == NATIVE:
                raise
            _log.warning("%s; its times are not used", error.message)
            return self._aligned(speech, text, said, began, unsound=True)
        self._add(native=1)
        self._check_now_and_then(speech, text, said)
        return speech

    def close(self) -> None:
        self._engine.close()

    def _aligned(self, speech: Speech, text: str, lexicon: Lexicon, began: float, *, unsound: bool = False) -> Speech:
        if self._choice == NATIVE:
            raise SpeechFailed(
                f"speech engine {self.name} does not say when its phones sound",
                advice="Set speech.aligner to auto, or to an aligner's name.",
            )
        aligner = self._aligner()
        try:
            found = self._limit.call(
                lambda: aligner.align(speech.samples, speech.rate, text, lexicon=lexicon),
                lambda what: AlignmentFailed(f"aligner {aligner.name} {what}"),
                seconds=remaining(began, self._limit),
            )
        except AlignmentFailed as error:
            self._add(unaligned=1)
            raise AlignmentFailed(f"speech engine {self.name}: {error.message}", advice=error.advice) from error
        except MaryError:
            self._add(unaligned=1)
            raise
        except Exception as error:
            self._add(unaligned=1)
            failed = f"speech engine {self.name}: aligner {aligner.name} failed: {type(error).__name__}: {error}"
            raise AlignmentFailed(failed) from error
        if (
            found.confidence < FOREIGN
            and len(found.words) >= FEW_WORDS
            and (unsound or level_changes(speech.samples, speech.rate) < STEADY)
        ):
            self._add(unaligned=1)
            raise SpeechFailed(
                f"speech engine {self.name} does not say the text (confidence {found.confidence:.2f} "
                f"of aligner {aligner.name})"
            )
        self._add(aligned=1)
        return replace(speech, phones=found.phones, words=found.words)

    # --- do both agree?

    def _check_now_and_then(self, speech: Speech, text: str, lexicon: Lexicon) -> None:
        if self._choice == NATIVE or self.count.native % CHECK_EVERY != CHECK_FIRST:
            return
        if self._checking.acquire(blocking=False):
            work = threading.Timer(CHECK_DELAY, self._check, (speech, text, lexicon))
            work.name, work.daemon = "mary-check-times", True
            work.start()

    def _check(self, speech: Speech, text: str, lexicon: Lexicon) -> None:
        try:
            aligner = self._aligner()
            found = aligner.align(speech.samples, speech.rate, text, lexicon=lexicon)
            apart = start_differences(speech.phones, found.phones)
            median = float(np.median(np.abs(apart))) if len(apart) else 0.0
            self._add(checked=1, disagreed=int(median > APART))
            log = _log.warning if median > APART else _log.info
            log(
                "phone times of %s and %s: %.0f ms apart in the median of %d phones",
                self.name, aligner.name, 1000 * median, len(apart),
            )  # fmt: skip
        except MaryError as error:
            _log.warning("phone times of %s could not be checked: %s", self.name, error.message)
        finally:
            self._checking.release()

    def _add(self, **more: int) -> None:
        with self._lock:
            self.count = replace(self.count, **{name: getattr(self.count, name) + n for name, n in more.items()})


def heard(speech: Speech, engine: str) -> Speech:
    """The speech itself if its sound is one, whether it has phones or not.

    Raises:
        SpeechFailed: names the engine and what is wrong with the samples: not one row of float32, not finite, over 1,
            or nothing to be heard.
    """
    samples = speech.samples
    wrong = ""
    if speech.rate <= 0:
        wrong = f"sample rate {speech.rate}"
    elif samples.ndim != 1 or samples.dtype != np.float32 or not len(samples):
        wrong = f"samples must be float32 of shape (n,), not {samples.dtype} of shape {samples.shape}"
    elif not np.isfinite(samples).all():
        wrong = "samples are not finite"
    elif (peak := float(np.abs(samples).max())) > 1.0:
        wrong = "samples exceed 1"
    elif peak < QUIETEST:
        wrong = "it made no sound"
    if wrong:
        raise SpeechFailed(f"speech engine {engine}: {wrong}")
    return speech


def level_changes(samples: NDArray[np.float32], rate: int) -> float:
    """Standard deviation of the level of 20 ms of sound each, dB; 0 for sound shorter than that.

    Args:
        samples: shape (n,).
        rate: samples a second.
    """
    size = max(1, round(0.020 * rate))
    frames = samples[: len(samples) // size * size].reshape(-1, size).astype(np.float64)
    if not len(frames):
        return 0.0
    return float(np.std(10 * np.log10(np.mean(frames**2, axis=1) + 1e-8)))


def _warm(aligner: Aligner) -> None:
    warm_up: Callable[[], None] | None = getattr(aligner, "warm_up", None)
    if warm_up is not None:
        warm_up()
