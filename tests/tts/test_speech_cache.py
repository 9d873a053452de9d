from __future__ import annotations

import pytest
from speakers import Odd

from app.errors import SpeechFailed
from app.speech import Speech
from app.tts.speech_cache import CachedEngine


def test_a_sentence_that_comes_again_costs_nothing() -> None:
    cached = CachedEngine(engine := Odd(), 10_000_000)
    first = cached.speak("hello", voice="mock")
    assert cached.speak("hello", voice="mock") is first
    cached.speak("hello", voice="mock", speed=2.0)
    cached.speak("hello", voice="mock", lexicon={"hello": ("B",)})
    cached.speak("hello")
    assert (len(engine.spoken), cached.hits, cached.misses) == (4, 1, 4)
    with pytest.raises(ValueError, match="read-only"):
        first.samples[0] = 1.0


def test_what_was_used_longest_ago_is_forgotten_first() -> None:
    size = Odd().speak("hello").samples.nbytes
    cached = CachedEngine(engine := Odd(), 2 * size)
    for text in ("hello", "hallo", "hello", "hullo", "hello", "hallo"):
        cached.speak(text)
    assert [text for text, _ in engine.spoken] == ["hello", "hallo", "hullo", "hallo"]
    assert cached.bytes <= 2 * size
    cached.speak("hello " * 20)  # larger than everything: not kept, and nothing is forgotten for it
    assert cached.speak("hallo") is not None
    assert len(engine.spoken) == 5


def test_failures_are_not_remembered() -> None:
    def broken(_: Speech) -> Speech:
        raise SpeechFailed("oops")

    cached = CachedEngine(engine := Odd(broken), 10_000_000)
    with pytest.raises(SpeechFailed):
        cached.speak("hello")
    engine.change = lambda speech: speech
    assert cached.speak("hello").words
    cached.warm_up()
    cached.close()
    assert (engine.warm, engine.closed, cached.voices()) == (1, 1, engine.voices())
