"""Sound in the making, and the speech of it: lips that follow a microphone or another program's voice.

Sound is handed on in pieces of `STEP` seconds (`app.align.ear`), whatever they cut. A piece is handed on when `LOOK`
seconds after it have been heard, because a phone is only known when it is over; `LEFT` seconds before it are listened
to once more each time. The first piece waits for `CUSHION` seconds more: pieces that came at the last moment would come
too late when the machine is busy. So what is pushed leaves after STEP + LOOK + CUSHION = 0.54 s at the latest, and some
time for the work (0.05 s), as long as sound is pushed at the pace of time. Sound is neither lost nor changed in order.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.align.dictionary import Dictionary
from app.align.ear import Ear
from app.align.recogniser import Recogniser, Samples
from app.errors import Gone, InputError, NothingToSay, OverCapacity
from app.speech import Speech

RATES = (16_000, 24_000, 48_000)
"""Samples a second that are taken."""

ASK_SECONDS = 0.1


class LiveSound:
    """Sound that is pushed, and its speech. Safe from any thread; one thread iterates `speeches`.

    Args:
        recogniser: hears the phones.
        rate: samples a second of what is pushed, one of `RATES`.
        transcript: what is said, whole, if it is known: then phones are the text's where it is what is heard, and words
            have times. Without it there are no words.
        dictionary: pronounces the transcript.
        limit: seconds that may wait to be spoken.
        wait: how long `speeches` waits before it says that there is nothing yet.

    Raises:
        InputError: another rate.
        NothingToSay: a transcript without a word that sounds.
    """

    def __init__(
        self,
        recogniser: Recogniser,
        rate: int,
        *,
        transcript: str = "",
        dictionary: Dictionary | None = None,
        limit: float = 60.0,
        wait: float = ASK_SECONDS,
    ) -> None:
        if rate not in RATES:
            known = ", ".join(f"{each:,}" for each in RATES)
            raise InputError(f"live sound of {rate:,} samples a second", field="rate", advice=f"Known: {known}.")
        self.rate = rate
        self._recogniser = recogniser
        self._limit = limit
        self._wait = wait
        self._words = (dictionary or Dictionary()).read(transcript) if transcript.strip() else ()
        if transcript.strip() and not any(word.pronunciations for word in self._words):
            raise NothingToSay("the transcript has no word that sounds", field="transcript")
        self._changed = threading.Condition()
        self._new: list[Samples] = []
        self._pushed = 0  # samples, since the beginning or `interrupt`
        self._given = 0.0  # seconds of them that have been handed on
        self._flushed = self._interrupted = self._ended = self._cancelled = False

    @property
    def waiting(self) -> float:
        """Seconds that were pushed and have not been handed on."""
        with self._changed:
            return self._pushed / self.rate - self._given

    def push_audio(self, sound: bytes | bytearray | memoryview | ArrayLike) -> None:
        """More sound, mono, in chunks of any size.

        Args:
            sound: 16-bit samples, little-endian, as bytes; or an array of int16 or of floats in [-1, 1].

        Raises:
            InputError: an odd number of bytes, another type or shape, or samples that are no numbers.
            Gone: `end` or `cancel` has been called.
            OverCapacity: more would wait than `limit`; nothing of `sound` is taken.
        """
        samples = _samples(sound)
        with self._changed:
            if self._ended:
                raise Gone("this sound has ended", advice="Begin another one.")
            if self._pushed / self.rate - self._given + len(samples) / self.rate > self._limit:
                raise OverCapacity(
                    f"{self._pushed / self.rate - self._given:.1f} s of sound wait to be spoken, "
                    f"more than {self._limit:g} s are not kept",
                    advice="Push it at the pace at which it is heard.",
                )
            self._new.append(samples)
            self._pushed += len(samples)
            self._changed.notify()

    def flush(self) -> None:
        """All that has been pushed is to be spoken without waiting for what follows it."""
        with self._changed:
            self._flushed = True
            self._changed.notify()

    def end(self) -> None:
        """Nothing follows. May be called again."""
        with self._changed:
            self._flushed = self._ended = True
            self._changed.notify()

    def interrupt(self) -> None:
        """Forget what has been pushed and not handed on; what is pushed from now on begins anew."""
        with self._changed:
            self._new.clear()
            self._pushed, self._given = 0, 0.0
            self._flushed, self._interrupted = False, True
            self._changed.notify()

    def cancel(self) -> None:
        """Forget what has been pushed and not handed on, and end."""
        with self._changed:
            self.interrupt()
            self._ended = self._cancelled = True
            self._changed.notify()

    def speeches(self) -> Iterator[Speech | None]:
        """The speech, a piece at a time; None when nothing could be handed on for a moment.

        Raises:
            RecognitionFailed: the recogniser broke down.
        """
        ear = Ear(self._recogniser, self.rate, self._words)
        while True:
            chunks, flushed, ended, interrupted, cancelled = self._take(ear)
            if cancelled:
                return
            if interrupted:
                ear = Ear(self._recogniser, self.rate, ())  # what the transcript says was interrupted, too
                yield None  # so that nothing of before and nothing of after comes of the same question
            ear.listen(chunks, last=flushed)
            spoken = False
            while (speech := ear.speech(flushed)) is not None:
                spoken = True
                with self._changed:
                    if self._interrupted:  # meanwhile
                        break
                    self._given = ear.given
                yield speech
            if flushed and not interrupted:
                ear.rest()
            if ended:
                with self._changed:
                    if not self._interrupted:
                        return
            elif not spoken:
                yield None

    def _take(self, ear: Ear) -> tuple[list[Samples], bool, bool, bool, bool]:
        """What has been pushed meanwhile, and whether it was flushed, ended, interrupted or cancelled."""

        def due() -> bool:
            return (
                self._flushed
                or self._interrupted
                or self._ended
                or self._pushed / self.rate - self._given >= ear.least_waiting
            )

        with self._changed:
            self._changed.wait_for(due, self._wait)
            taken = self._new, self._flushed, self._ended, self._interrupted, self._cancelled
            self._new, self._flushed, self._interrupted = [], False, False
            return taken


def _samples(sound: bytes | bytearray | memoryview | ArrayLike) -> Samples:
    """Mono float32 in [-1, 1]; raises InputError. See `LiveSound.push_audio`."""
    if isinstance(sound, bytes | bytearray | memoryview):
        data = bytes(sound)
        if len(data) % 2:
            raise InputError(
                f"{len(data):,} bytes are no whole 16-bit samples",
                advice="Send PCM, signed 16-bit little-endian, mono.",
            )
        return np.frombuffer(data, "<i2").astype(np.float32) / np.float32(32768)
    array: NDArray[np.generic] = np.asarray(sound)
    if array.ndim != 1:
        raise InputError(f"live sound must be mono: shape (n,), not {array.shape}")
    if array.dtype == np.int16:
        return array.astype(np.float32) / np.float32(32768)
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"live sound must be int16 or floats, not {array.dtype}")
    if not np.isfinite(array).all():
        raise InputError("live sound has samples that are no numbers")
    return np.clip(array.astype(np.float32), -1.0, 1.0)
