"""Words, marks and mouth shapes, told to listeners shortly before they are heard and seen."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from app.stream.captions import Captions, SpokenWord
from app.stream.clock import FPS, SAMPLE_RATE, StreamClock
from app.stream.events import Event, EventBoard
from app.stream.pieces import Piece
from app.stream.visemes import viseme

CUE_LEAD = 0.25
"""Seconds between telling of a word and its sound leaving the server; a viewer hears it later still."""


@dataclass(frozen=True, slots=True)
class _Cue:
    start: float  # seconds on the stream's clock
    event: Event
    word: SpokenWord | None


class Cues:
    """What has its place on the stream's clock and has not been told yet. On one event loop.

    Args:
        events: told of every word and viseme.
        captions: given every word.
    """

    def __init__(self, events: EventBoard, captions: Captions) -> None:
        self._events = events
        self._captions = captions
        self._waiting: deque[_Cue] = deque()

    def add(self, utterance: str, piece: Piece, base: int, clock: StreamClock) -> None:
        """Take the words, marks and phones of a piece; `base` is the stream's frame that its times count from."""
        origin = base / FPS
        cues = []
        for word in piece.words:
            spoken = SpokenWord(utterance, word.text, origin + word.start, origin + word.end)
            data = {"utterance": utterance, "text": word.text, **_times(spoken.start, spoken.end, clock)}
            cues.append(_Cue(spoken.start, Event("word", data), spoken))
        for mark in piece.marks:
            at = origin + mark.time
            data = {"utterance": utterance, "name": mark.name, **_when(at, clock)}
            cues.append(_Cue(at, Event("mark", data), None))
        for phone in piece.phones:
            shape, start, end = viseme(phone.symbol), origin + phone.start, origin + phone.end
            data = {
                "utterance": utterance,
                "phone": phone.symbol,
                "azure": shape.azure,
                "oculus": shape.oculus,
                **_times(start, end, clock),
            }
            cues.append(_Cue(start, Event("viseme", data), None))
        self._waiting.extend(sorted(cues, key=lambda cue: cue.start))  # stable: a word before its first phone

    def tell(self, sent: int) -> None:
        """Tell what is heard soon; `sent` samples have left."""
        soon = sent / SAMPLE_RATE + CUE_LEAD
        while self._waiting and self._waiting[0].start <= soon:
            cue = self._waiting.popleft()
            self._events.post(cue.event)
            if cue.word is not None:
                self._captions.add(cue.word)

    def cut(self, sent: int) -> None:
        """Speech is cut short where `sent` samples have left: what was to come does not."""
        self._waiting.clear()
        self._captions.cut(sent / SAMPLE_RATE)


def _times(start: float, end: float, clock: StreamClock) -> dict[str, float]:
    return {**_when(start, clock), "end_time": round(float(end), 4)}


def _when(at: float, clock: StreamClock) -> dict[str, float]:
    return {"media_time": round(float(at), 4), "wall_ms": round(float(clock.wall_ms(at)), 1)}
