"""A time limit for calls that cannot be stopped: they are left behind, and only so many may be."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from app.align.dictionary import NO_LEXICON, Lexicon
from app.errors import MaryError, SpeechFailed
from app.speech import Speech
from app.tts.engine import SpeechEngine, Voice

MOST_LEFT = 4
"""Calls left behind that have not returned; while there are so many, nothing new is asked for."""

T = TypeVar("T")


class Limit:
    """Runs calls that must not take long, each in a thread of its own. Safe from any thread.

    Args:
        seconds: that a call may take.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._lock = threading.Lock()
        self._left: set[threading.Thread] = set()

    @property
    def left(self) -> int:
        """Calls left behind that have not returned yet."""
        with self._lock:
            self._left = {thread for thread in self._left if thread.is_alive()}
            return len(self._left)

    def call(self, work: Callable[[], T], late: Callable[[str], MaryError], *, seconds: float | None = None) -> T:
        """What `work` returns or raises.

        Args:
            work: called in another thread.
            late: makes the error of a sentence that says what was late.
            seconds: another limit than the usual one.

        Raises:
            MaryError: what `late` makes: the call takes longer, or too many others have not returned.
        """
        limit = self.seconds if seconds is None else seconds
        if self.left >= MOST_LEFT:
            raise late("does not return from earlier sentences")
        outcome: list[T] = []
        failure: list[BaseException] = []

        def run() -> None:
            try:
                outcome.append(work())
            except BaseException as error:
                failure.append(error)

        thread = threading.Thread(target=run, name="mary-limited", daemon=True)
        thread.start()
        thread.join(max(0.0, limit))
        if failure:
            raise failure[0]
        if not outcome:
            with self._lock:
                self._left.add(thread)
            raise late(f"took longer than {self.seconds:g} s for one sentence")
        return outcome[0]


class LimitedEngine:
    """An engine that answers in time or fails; what it raises of its own becomes a `SpeechFailed` with its name.

    Args:
        engine: to be limited.
        limit: shared with whatever else counts as the same sentence.
    """

    def __init__(self, engine: SpeechEngine, limit: Limit) -> None:
        self._engine = engine
        self._limit = limit
        self.name = engine.name
        self.pronounces = engine.pronounces

    def voices(self) -> tuple[Voice, ...]:
        return self._engine.voices()

    def warm_up(self) -> None:
        self._engine.warm_up()

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        try:
            return self._limit.call(
                lambda: self._engine.speak(text, voice=voice, speed=speed, lexicon=lexicon),
                lambda what: SpeechFailed(f"speech engine {self.name} {what}"),
            )
        except MaryError:
            raise
        except Exception as error:
            raise SpeechFailed(f"speech engine {self.name} failed: {type(error).__name__}: {error}") from error

    def close(self) -> None:
        self._engine.close()


def remaining(since: float, limit: Limit) -> float:
    """Seconds left of a limit that has been running since then (monotonic)."""
    return limit.seconds - (time.monotonic() - since)
