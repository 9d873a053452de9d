from __future__ import annotations

import threading

import pytest
from speakers import Gate, Odd

from app.errors import NotFound, SpeechFailed
from app.speech import Speech
from app.tts.limit import MOST_LEFT, Limit, LimitedEngine


def test_what_is_in_time_is_handed_on() -> None:
    engine = Odd()
    limited = LimitedEngine(engine, Limit(60))
    assert limited.speak("hello you", speed=2.0).words == engine.speak("hello you", speed=2.0).words
    assert (limited.name, limited.pronounces, limited.voices()) == ("odd", True, engine.voices())
    limited.warm_up()
    limited.close()
    assert (engine.warm, engine.closed) == (1, 1)


def test_what_is_late_fails_with_its_name_and_the_next_sentence_works() -> None:
    gate = Gate()
    engine = Odd(gate)
    limit = Limit(0.05)
    limited = LimitedEngine(engine, limit)
    with pytest.raises(SpeechFailed, match=r"speech engine odd took longer than 0\.05 s"):
        limited.speak("hello")
    assert limit.left == 1
    engine.change = lambda speech: speech
    limit.seconds = 60
    assert limited.speak("hello").words
    gate.opened.set()
    for thread in threading.enumerate():
        if thread.name == "mary-limited":
            thread.join(60)
    assert limit.left == 0


def test_calls_that_do_not_return_do_not_add_up() -> None:
    gate = Gate()
    limited = LimitedEngine(engine := Odd(gate), Limit(0.02))
    for _ in range(MOST_LEFT):
        with pytest.raises(SpeechFailed, match="longer"):
            limited.speak("hello")
    with pytest.raises(SpeechFailed, match="does not return from earlier sentences"):
        limited.speak("hello")
    assert len(engine.spoken) == MOST_LEFT
    gate.opened.set()


def test_an_error_of_its_own_names_the_engine() -> None:
    def broken(_: Speech) -> Speech:
        raise ZeroDivisionError("oops")

    def lost(_: Speech) -> Speech:
        raise NotFound("no such voice", field="voice")

    with pytest.raises(SpeechFailed, match="speech engine odd failed: ZeroDivisionError: oops"):
        LimitedEngine(Odd(broken), Limit(60)).speak("hello")
    with pytest.raises(NotFound, match="no such voice"):
        LimitedEngine(Odd(lost), Limit(60)).speak("hello")
