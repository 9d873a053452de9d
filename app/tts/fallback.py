"""A second engine that speaks when the first one fails."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from app.align.dictionary import NO_LEXICON, Lexicon
from app.errors import AlignmentFailed, MaryError, MissingExtra, SpeechFailed
from app.speech import Speech
from app.tts.engine import SpeechEngine, Voice

REST_SECONDS = 30.0
"""For so long an engine that has failed is not asked again: each sentence would wait for its time limit."""

FAILURES = (SpeechFailed, AlignmentFailed, MissingExtra)
"""Of the engine, not of its caller; a voice that somebody asks for is looked at before (`choose_voice`)."""

_log = logging.getLogger(__name__)


class FallbackEngine:
    """Speaks with `first`, and with `second` while that one fails; the voices are those of `first`.

    Args:
        first: asked unless it has failed in the last `REST_SECONDS`.
        second: speaks with its installed voice of the same sex, if it has one.
        clock: seconds, monotonic.

    Attributes:
        count: sentences that `second` has spoken.
    """

    def __init__(
        self, first: SpeechEngine, second: SpeechEngine, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.name = first.name
        self.pronounces = first.pronounces
        self.count = 0
        self._first, self._second = first, second
        self._clock = clock
        self._lock = threading.Lock()
        self._asked_again_at = clock()

    def voices(self) -> tuple[Voice, ...]:
        return self._first.voices()

    def warm_up(self) -> None:
        """Both; the first one may fail, since the second is there for that."""
        self._second.warm_up()
        try:
            self._first.warm_up()
        except FAILURES as error:
            self._failed(error)

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        if self._clock() >= self._asked_again_at:
            try:
                return self._first.speak(text, voice=voice, speed=speed, lexicon=lexicon)
            except FAILURES as error:
                self._failed(error)
        with self._lock:
            self.count += 1
        return self._second.speak(text, voice=self._like(voice), speed=speed, lexicon=lexicon)

    def close(self) -> None:
        self._first.close()
        self._second.close()

    def _failed(self, error: MaryError) -> None:
        self._asked_again_at = self._clock() + REST_SECONDS
        _log.warning("%s; %s speaks for %g s", error.message, self._second.name, REST_SECONDS)

    def _like(self, voice: str) -> str:
        """A voice of the second engine for one of the first."""
        sex = next((each.sex for each in self._first.voices() if each.id == voice), "")
        usable = [each for each in self._second.voices() if each.installed]
        return next((each.id for each in usable if sex and each.sex == sex), "")
