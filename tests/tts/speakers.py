"""Speech engines that behave in some way, for the tests."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

from app.align.dictionary import NO_LEXICON, Lexicon
from app.speech import Speech
from app.tts.mock import MockEngine


class Odd(MockEngine):
    """Changes what the mock engine says; or raises, or waits, in `change`.

    Attributes:
        spoken: texts and voices that were asked for.
        closed, warm: how often.
    """

    def __init__(self, change: Callable[[Speech], Speech] = lambda speech: speech, name: str = "odd") -> None:
        self.name = name
        self.change = change
        self.spoken: list[tuple[str, str]] = []
        self.closed = self.warm = 0

    def warm_up(self) -> None:
        self.warm += 1

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        self.spoken.append((text, voice))
        return self.change(super().speak(text, speed=speed, lexicon=lexicon))

    def close(self) -> None:
        self.closed += 1


def untimed(speech: Speech) -> Speech:
    """As an engine that does not know its phones."""
    return replace(speech, phones=(), words=())


class Gate:
    """A change that waits until it is opened."""

    def __init__(self) -> None:
        self.opened = threading.Event()

    def __call__(self, speech: Speech) -> Speech:
        assert self.opened.wait(60)
        return speech
