from __future__ import annotations

import asyncio

import numpy as np

from app.speech import Mark, Phone, Word
from app.stream.captions import Captions
from app.stream.clock import SAMPLE_RATE, StreamClock
from app.stream.cues import CUE_LEAD, Cues
from app.stream.events import Event, EventBoard
from app.stream.pieces import Piece
from app.stream.seats import Seats


class Told:
    def __init__(self) -> None:
        self.events: list[Event] = []
        board = EventBoard(Seats(1, "listeners"))
        board.post = self.events.append  # type: ignore[method-assign]
        self.captions = Captions()
        self.cues = Cues(board, self.captions)
        self.clock = StreamClock(lambda: 7.0, lambda: 1e6)

    def add(self, base: int = 50) -> None:
        phones = (Phone("HH", 0.0, 0.1), Phone("AY", 0.1, 0.5), Phone("B", 0.5, 1.0), Phone("AY", 1.0, 1.4))
        words = (Word("Hi,", 0.0, 0.5), Word("bye.", 0.5, 1.4))
        marks = (Mark("there", 0.5),)
        empty = np.zeros(0, np.float32)
        self.cues.add("u", Piece(0, empty, 0, empty[None], None, phones, words, marks), base, self.clock)

    def tell(self, seconds: float) -> list[str]:
        self.events.clear()
        self.cues.tell(round(seconds * SAMPLE_RATE))
        return [event.data.get("text") or event.data.get("name") or event.data["phone"] for event in self.events]


def test_words_and_visemes_are_told_shortly_before_they_are_heard() -> None:
    told = Told()
    told.add()
    assert told.tell(2.0 - CUE_LEAD - 0.01) == []
    assert told.tell(2.0 - CUE_LEAD) == ["Hi,", "HH"]
    first, second = told.events
    assert (first.name, second.name) == ("word", "viseme")
    assert first.data == {
        "utterance": "u", "text": "Hi,", "media_time": 2.0, "end_time": 2.5, "wall_ms": 1e9 + 2000.0
    }  # fmt: skip
    assert second.data == {
        "utterance": "u", "phone": "HH", "azure": 12, "oculus": "kk",
        "media_time": 2.0, "end_time": 2.1, "wall_ms": 1e9 + 2000.0,
    }  # fmt: skip
    assert told.tell(2.5) == ["AY", "bye.", "there", "B"]
    assert told.events[2] == Event(
        "mark", {"utterance": "u", "name": "there", "media_time": 2.5, "wall_ms": 1e9 + 2500.0}
    )
    assert [word.text for word in told.captions.words()] == ["Hi,", "bye."]
    assert told.tell(10.0) == ["AY"]
    assert told.tell(20.0) == []


def test_what_is_cut_off_is_neither_told_nor_a_caption() -> None:
    told = Told()
    told.add()
    told.tell(2.3)
    told.cues.cut(round(2.4 * SAMPLE_RATE))
    assert told.tell(10.0) == []
    assert [(word.text, word.end) for word in told.captions.words()] == [("Hi,", 2.4)]


async def test_a_pile_of_visemes_does_not_hold_up_the_loop() -> None:
    told = Told()
    for n in range(200):
        told.add(base=50 * n)
    await asyncio.sleep(0)
    assert len(told.tell(1e6)) == 1400
