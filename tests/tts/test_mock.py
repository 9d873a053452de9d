from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import NotFound, NothingToSay
from app.speech import PHONES, SILENCE
from app.tts.engine import SpeechEngine
from app.tts.mock import CONSONANT, EDGE, RATE, VOWEL, MockEngine, spell
from app.tts.narrate import check


def test_is_a_speech_engine_with_one_voice() -> None:
    engine = MockEngine()
    assert isinstance(engine, SpeechEngine)
    assert [voice.id for voice in engine.voices()] == ["mock"]
    engine.warm_up()


def test_times_are_exact() -> None:
    speech = check(MockEngine().speak("bat", voice="mock"), "mock")
    assert [phone.symbol for phone in speech.phones] == [SILENCE, "B", "AE", "T", SILENCE]
    lengths = [phone.end - phone.start for phone in speech.phones]
    assert lengths == pytest.approx([EDGE, CONSONANT, VOWEL, CONSONANT, EDGE], abs=0.5 / RATE)
    assert speech.words[0].text == "bat"
    assert (speech.words[0].start, speech.words[0].end) == (speech.phones[1].start, speech.phones[3].end)


def test_silence_is_zero_and_phones_sound() -> None:
    speech = MockEngine().speak("One, two... three!", voice="mock")
    assert sum(phone.symbol == SILENCE for phone in speech.phones) == 4
    for phone in speech.phones:
        part = speech.samples[round(phone.start * RATE) : round(phone.end * RATE)]
        assert bool(part.any()) == (phone.symbol != SILENCE)


def test_every_phone_sounds_different() -> None:
    speech = MockEngine().speak("bcdf", voice="")
    parts = [speech.samples[round(p.start * RATE) :][:400] for p in speech.phones if p.symbol != SILENCE]
    assert not any(np.allclose(a, b) for a, b in pairwise(parts))


def test_same_text_same_samples_and_speed_shortens() -> None:
    engine = MockEngine()
    one, two = engine.speak("hello there", voice="mock"), engine.speak("hello there", voice="mock", speed=2.0)
    np.testing.assert_array_equal(one.samples, engine.speak("hello there", voice="mock").samples)
    assert two.duration == pytest.approx(one.duration / 2, abs=0.001)


@pytest.mark.parametrize(
    ("written", "phones"),
    [("ship", "SH IH P"), ("42", "F AO R T UW"), ("Hello", "HH EH L OW"), ("Łód", "L OW D"), ("&", "AE N D")],
)
def test_spell(written: str, phones: str) -> None:
    assert " ".join(spell(written)) == phones


@given(st.text(max_size=60))
def test_speaks_any_text(text: str) -> None:
    try:
        speech = MockEngine().speak(text, voice="mock")
    except NothingToSay:
        assert not any(character.isalnum() for character in text)
    else:
        check(speech, "mock")
        assert {phone.symbol for phone in speech.phones} <= set(PHONES)


def test_other_scripts_are_spoken() -> None:
    assert len(MockEngine().speak("你好", voice="mock").phones) == 4


def test_nothing_and_unknown_voice() -> None:
    with pytest.raises(NothingToSay):
        MockEngine().speak("...", voice="mock")
    with pytest.raises(NotFound, match="heart"):
        MockEngine().speak("hello", voice="heart")
