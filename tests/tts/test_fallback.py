from __future__ import annotations

from dataclasses import replace

import pytest
from speakers import Odd

from app.errors import MissingExtra, NotFound, SpeechFailed
from app.speech import Speech
from app.tts.engine import Voice
from app.tts.fallback import REST_SECONDS, FallbackEngine


def broken(_: Speech) -> Speech:
    raise SpeechFailed("speech engine first failed")


def test_the_second_speaks_while_the_first_fails() -> None:
    now = 0.0
    first, second = Odd(broken, "first"), Odd(name="second")
    engine = FallbackEngine(first, second, clock=lambda: now)
    assert engine.speak("one").words[0].text == "one"
    engine.speak("two")
    assert (len(first.spoken), len(second.spoken), engine.count) == (1, 2, 2)  # it is not asked again at once
    now, first.change = REST_SECONDS, lambda speech: speech
    engine.speak("three")
    assert (len(first.spoken), len(second.spoken)) == (2, 2)
    engine.close()
    assert (first.closed, second.closed) == (1, 1)
    assert engine.name == "first"


def test_what_is_not_installed_is_replaced() -> None:
    def lacking(_: Speech) -> Speech:
        raise MissingExtra("speech engine first needs a library")

    engine = FallbackEngine(Odd(lacking, "first"), second := Odd(name="second"))
    assert engine.speak("one").words
    assert second.spoken


def test_a_callers_mistake_is_not_a_failure() -> None:
    def lost(_: Speech) -> Speech:
        raise NotFound("no such voice")

    engine = FallbackEngine(Odd(lost), second := Odd())
    with pytest.raises(NotFound):
        engine.speak("one", voice="nobody")
    assert not second.spoken


def test_the_other_voice_is_of_the_same_sex() -> None:
    class Choir(Odd):
        def voices(self) -> tuple[Voice, ...]:
            (voice,) = super().voices()
            return (
                replace(voice, id=f"{self.name}-bass", sex="male"),
                replace(voice, id=f"{self.name}-gone", sex="female", installed=False),
                replace(voice, id=f"{self.name}-alto", sex="female"),
            )

    engine = FallbackEngine(Choir(broken, "first"), second := Choir(name="second"))
    for voice in ("first-alto", "first-bass", ""):
        engine.speak("one", voice=voice)
    assert [voice for _, voice in second.spoken] == ["second-alto", "second-bass", ""]


def test_a_first_one_that_cannot_be_loaded_does_not_end_the_start() -> None:
    class Dead(Odd):
        def warm_up(self) -> None:
            raise SpeechFailed("speech engine dead: no answer")

    engine = FallbackEngine(Dead(), second := Odd())
    engine.warm_up()
    assert second.warm == 1
    assert engine.speak("one").words
    assert second.spoken
