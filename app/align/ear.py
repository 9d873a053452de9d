"""Hears sound that comes bit by bit, and cuts it into speech that can be handed on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import soxr

from app.align.dictionary import WrittenWord
from app.align.following import Follower
from app.align.recogniser import RATE, Recogniser, Samples, phones
from app.speech import SILENCE, Phone, Speech, Word

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


class Ear:
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
        self._heard = Track(rate, RATE)
        self._loud = Track(rate, OUT_RATE)
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
        return Speech(
            samples, OUT_RATE, tuple(inside), self._words(shown, start, end), around=tuple(around),
            ahead=self._loud.peek(end, min(heard, end + LOOK)), recognised=not self._written,
        )  # fmt: skip

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


class Track:
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
