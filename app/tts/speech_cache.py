"""Remembers the speech of sentences, so that a prompt that comes again costs nothing."""

from __future__ import annotations

import threading
from collections import OrderedDict

from app.align.dictionary import NO_LEXICON, Lexicon
from app.speech import Speech
from app.tts.engine import SpeechEngine, Voice

_Key = tuple[str, str, float, tuple[tuple[str, tuple[str, ...]], ...]]


class CachedEngine:
    """An engine whose last sentences are kept, those used longest ago forgotten first. Safe from any thread.

    Args:
        engine: speaks what is not known yet. What it raises is not remembered.
        most_bytes: of sound that is kept.

    Attributes:
        hits, misses: sentences that were known, and that were not.
    """

    def __init__(self, engine: SpeechEngine, most_bytes: int) -> None:
        self.name = engine.name
        self.pronounces = engine.pronounces
        self.hits = self.misses = 0
        self._engine = engine
        self._most = most_bytes
        self._lock = threading.Lock()
        self._kept: OrderedDict[_Key, Speech] = OrderedDict()
        self._bytes = 0

    @property
    def bytes(self) -> int:
        """Of sound that is kept now."""
        return self._bytes

    def voices(self) -> tuple[Voice, ...]:
        return self._engine.voices()

    def warm_up(self) -> None:
        self._engine.warm_up()

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        key = (text, voice, speed, tuple(sorted(lexicon.items())))
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                self.hits += 1
                return self._kept[key]
            self.misses += 1
        speech = self._engine.speak(text, voice=voice, speed=speed, lexicon=lexicon)
        self._keep(key, speech)
        return speech

    def close(self) -> None:
        self._engine.close()

    def _keep(self, key: _Key, speech: Speech) -> None:
        size = speech.samples.nbytes
        if size > self._most:
            return
        speech.samples.flags.writeable = False  # many will read it
        with self._lock:
            known = self._kept.pop(key, None)  # two may have asked for the same at once
            self._bytes += size - (known.samples.nbytes if known else 0)
            self._kept[key] = speech
            while self._bytes > self._most:
                _, oldest = self._kept.popitem(last=False)
                self._bytes -= oldest.samples.nbytes
