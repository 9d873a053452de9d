"""Sound in the making, and the speech of it: lips that follow a microphone or another program's voice.

Sound is handed on in pieces of `STEP` seconds, whatever they cut. A piece is handed on when `LOOK` seconds after it
have been heard, because a phone is only known when it is over; `LEFT` seconds before it are listened to once more each
time. The first piece waits for `CUSHION` seconds more: pieces that came at the last moment would come too late when the
machine is busy. So what is pushed leaves after STEP + LOOK + CUSHION = 0.54 s at the latest, and some time for the work
(0.05 s), as long as sound is pushed at the pace of time. Sound is neither lost nor changed in order.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import soxr
from numpy.typing import ArrayLike, NDArray

from app.align.dictionary import Dictionary, WrittenWord
from app.align.following import Follower
from app.align.recogniser import RATE, Recogniser, Samples, phones
from app.errors import Gone, InputError, OverCapacity
from app.speech import SILENCE, Phone, Speech, Word

RATES = (16_000, 24_000, 48_000)
"""Samples a second that are taken."""
OUT_RATE = 48_000
"""Samples a second of the speech: what streams are made of, so that it is resampled once and not piece by piece."""

STEP = 0.2
"""Seconds of a piece: five pictures."""
LOOK = 0.2
"""Seconds that are heard after a piece before it is handed on."""
CUSHION = 0.14
"""Seconds by which the first piece waits longer, which every later one then has to spare."""
LONGEST = 1.0
"""Seconds of a piece when more than a `STEP` waits."""
LEFT = 1.0
"""Seconds before a piece that are listened to with it."""
UNSURE = 0.08
"""Seconds at the end of what has been heard in which phones may be missing yet."""
SLIVER = 0.03
"""Seconds; what is left of a phone behind the last piece, if it is heard as another one now, lasts at least so long."""
LEAST_WORD = 0.06
"""Seconds that each phone of a word will take that has not been heard."""
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
        ear = _Ear(self._recogniser, self.rate, self._words)
        while True:
            chunks, flushed, ended, interrupted, cancelled = self._take(ear)
            if cancelled:
                return
            if interrupted:
                ear = _Ear(self._recogniser, self.rate, ())  # what the transcript says was interrupted, too
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

    def _take(self, ear: _Ear) -> tuple[list[Samples], bool, bool, bool, bool]:
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


@dataclass(frozen=True, slots=True)
class _Shown:
    """A phone as it is shown.

    Attributes:
        symbol: of the text's phone, or of the one heard.
        heard: of the one heard.
        start, end: seconds.
        number: of the text's phone; -1: not of the text.
    """

    symbol: str
    heard: str
    start: float
    end: float
    number: int = -1


class _Ear:
    """Hears sound that comes bit by bit and cuts it into speech. Times in seconds since it began.

    Attributes:
        given: up to where speech has been handed on.
        least_waiting: seconds behind `given` that are needed for another piece.
    """

    def __init__(self, recogniser: Recogniser, rate: int, words: Sequence[WrittenWord]) -> None:
        self.given = 0.0
        self.least_waiting = STEP + LOOK + CUSHION
        self._recogniser = recogniser
        self._follower = Follower(words)
        self._written = [word.text for word in words]
        self._told = -1  # number of the last word handed on
        self._heard = _Track(rate, RATE)
        self._loud = _Track(rate, OUT_RATE)
        self._past: list[_Shown] = []  # phones handed on, those of the last moment

    def listen(self, chunks: Sequence[Samples], *, last: bool) -> None:
        """More sound; `last`: what the resamplers hold back is wanted, too."""
        for track in (self._heard, self._loud):
            track.add(chunks, last=last)

    def rest(self) -> None:
        """All is handed on, and what comes next may be long in coming: it waits for its cushion again."""
        self.least_waiting = STEP + LOOK + CUSHION

    def speech(self, last: bool) -> Speech | None:
        """The next piece, if enough is known.

        Args:
            last: nothing follows what has been heard.
        """
        heard = self._loud.end if last else min(self._loud.end, self._heard.end)
        waiting = heard - self.given
        if last:
            length = min(waiting, LONGEST)
        elif waiting < self.least_waiting - 1e-6:
            return None
        else:
            length = (min(waiting - LOOK, LONGEST) + 1e-6) // STEP * STEP
        samples = self._loud.take(self.given, self.given + length)
        if not len(samples):
            return None
        self.least_waiting = STEP + LOOK
        start, end = self.given, self.given + len(samples) / OUT_RATE
        shown = self._shown(start, end, min(heard, end + LOOK + STEP), last=last and end >= heard - 1e-6)
        self.given = end
        self._heard.forget(end - LEFT)
        around = [Phone(each.symbol, each.start - start, each.end - start) for each in shown]
        inside = _clipped(around, end - start)
        self._past = [replace(each, end=min(each.end, end)) for each in shown if end - LEFT < each.start < end]
        return Speech(samples, OUT_RATE, tuple(inside), self._words(shown, start, end), around=tuple(around))

    def _shown(self, start: float, end: float, known: float, *, last: bool) -> list[_Shown]:
        """Phones handed on, those of this piece, and those after it as far as they are known."""
        first = max(0.0, start - LEFT)
        window = self._heard.peek(first, known)
        heard = phones(self._recogniser.hear(window), window)
        laid = [Phone(each.symbol, each.start + first, each.end + first) for each in heard]
        sure = known if last else max(end, known - UNSURE)
        fresh = [
            Phone(each.symbol, max(each.start, start), min(each.end, sure))
            for each in laid
            if each.end > start and each.start < sure
        ]
        if not fresh:  # the rest of a resampler's last sample
            fresh = [Phone(SILENCE, start, end)]
        fresh[0] = replace(fresh[0], start=start)
        fresh[-1] = replace(fresh[-1], end=max(fresh[-1].end, end))
        if len(fresh) > 1 and self._past and fresh[0].symbol != self._past[-1].heard and _length(fresh[0]) < SLIVER:
            fresh[1] = replace(fresh[1], start=start)
            del fresh[0]
        return self._named(fresh, end)

    def _named(self, fresh: Sequence[Phone], end: float) -> list[_Shown]:
        """The phones as the text has them, joined to those handed on."""
        shown = list(self._past)
        goes_on = bool(shown) and shown[-1].heard == fresh[0].symbol
        if goes_on:  # the same phone, cut in two by the end of the last piece
            shown[-1] = replace(shown[-1], end=fresh[0].end)
        new = fresh[1:] if goes_on else fresh
        spoken = [each for each in new if each.symbol != SILENCE]
        settled = sum(each.start < end for each in spoken)
        places = iter(self._follower.follow([each.symbol for each in spoken], settled))
        for each in new:
            if each.symbol == SILENCE:
                shown.append(_Shown(SILENCE, SILENCE, each.start, each.end))
                continue
            numbers = next(places).numbers
            if not numbers:
                if not self._follower.lost and shown and shown[-1].number >= 0 and shown[-1].end >= each.start - 1e-6:
                    shown[-1] = replace(
                        shown[-1], end=each.end, heard=each.symbol
                    )  # not in the text: no phone of its own
                else:
                    shown.append(_Shown(each.symbol, each.symbol, each.start, each.end))
                continue
            edges = np.linspace(each.start, each.end, len(numbers) + 1).tolist()
            for at, number in enumerate(numbers):
                symbol = self._follower.symbols[number]
                shown.append(_Shown(symbol, each.symbol, edges[at], edges[at + 1], number))
        return shown

    def _words(self, shown: Sequence[_Shown], start: float, end: float) -> tuple[Word, ...]:
        """The words that begin in this piece."""
        owners = self._follower.owners
        times: dict[int, tuple[float, float, int]] = {}
        for each in shown:
            if each.number >= 0:
                word = owners[each.number]
                times[word] = (times.get(word, (each.start, 0.0, 0))[0], each.end, each.number)
        words = []
        for number in sorted(times):
            begins, ends, phone = times[number]
            if number <= self._told or begins >= end:
                continue
            self._told = number
            left = len(owners) - 1 - owners[::-1].index(number) - phone  # its phones that were not heard yet
            begins = max(begins, start)
            words.append(Word(self._written[number], begins - start, max(begins, ends) + left * LEAST_WORD - start))
        return tuple(words)


class _Track:
    """Sound at another rate, from a moving beginning on. Times in seconds since the first sample."""

    def __init__(self, rate: int, wanted: int) -> None:
        self._rate, self._wanted = rate, wanted
        self._stream = self._resampler()
        self._samples = np.zeros(0, np.float32)
        self._first = 0  # number of the first sample kept
        self._taken = 0  # samples pushed since the last one that was flushed
        self._made = 0  # samples made of them

    @property
    def end(self) -> float:
        return (self._first + len(self._samples)) / self._wanted

    def add(self, chunks: Sequence[Samples], *, last: bool) -> None:
        pushed = np.concatenate([*chunks, np.zeros(0, np.float32)])
        if self._stream is None:
            made = pushed
        else:
            made = self._stream.resample_chunk(pushed, last=last)
            self._taken += len(pushed)
            self._made += len(made)
            if last:  # exactly as long as what was pushed, so that nothing adds up
                missing = round(self._taken * self._wanted / self._rate) - self._made
                made = made[: len(made) + missing] if missing < 0 else np.pad(made, (0, missing))
                self._stream, self._taken, self._made = self._resampler(), 0, 0
        self._samples = np.concatenate([self._samples, np.clip(made, -1.0, 1.0)])

    def peek(self, start: float, end: float) -> Samples:
        return self._samples[max(0, self._at(start)) : max(0, self._at(end))]

    def take(self, start: float, end: float) -> Samples:
        """As `peek`; what lies before `end` is forgotten."""
        samples = self.peek(start, end)
        self.forget(end)
        return samples

    def forget(self, end: float) -> None:
        """Keep nothing before `end`."""
        count = min(max(0, self._at(end)), len(self._samples))
        self._samples = self._samples[count:]
        self._first += count

    def _at(self, time: float) -> int:
        return round(time * self._wanted) - self._first

    def _resampler(self) -> soxr.ResampleStream | None:
        if self._rate == self._wanted:
            return None
        return soxr.ResampleStream(self._rate, self._wanted, 1, dtype="float32", quality="MQ")


def _clipped(around: Sequence[Phone], duration: float) -> list[Phone]:
    """Those within a piece, from 0 to its end."""
    inside = [
        Phone(each.symbol, max(each.start, 0.0), min(each.end, duration))
        for each in around
        if each.end > 1e-6 and each.start < duration - 1e-6
    ]
    inside[0] = replace(inside[0], start=0.0)
    inside[-1] = replace(inside[-1], end=duration)
    return inside


def _length(phone: Phone) -> float:
    return phone.end - phone.start


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
