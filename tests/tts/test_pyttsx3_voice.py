import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from maltreat import survives_a_hang, survives_a_kill, without_espeak

from app.align.pocketsphinx import PocketSphinxAligner
from app.errors import MissingExtra, NotFound, NothingToSay
from app.tts.engine import SpeechEngine
from app.tts.limit import Limit
from app.tts.narrate import check
from app.tts.pyttsx3_voice import Pyttsx3Engine
from app.tts.registry import create
from app.tts.timed import AUTO, TimedEngine

pytest.importorskip("espeakng_loader", reason="espeak-ng is not installed: pip install 'mary[espeak]'")


@pytest.fixture(scope="module")
def engine() -> Iterator[Pyttsx3Engine]:
    engine = Pyttsx3Engine()
    engine.warm_up()
    engine.warm_up()
    yield engine
    engine.close()


def test_it_is_an_engine(engine: Pyttsx3Engine) -> None:
    assert isinstance(engine, SpeechEngine)
    assert isinstance(create("pyttsx3", {"seconds": 5}), Pyttsx3Engine)


def test_a_sentence_says_what_is_written(engine: Pyttsx3Engine) -> None:
    text = "Please call Stella, and ask her to bring these things."
    speech = engine.speak(text)
    assert speech.rate == 22_050
    assert speech.samples.dtype == "float32"
    assert speech.phones == speech.words == ()
    with PocketSphinxAligner() as aligner:
        assert aligner.align(speech.samples, speech.rate, text).confidence > 0.5
        timed = TimedEngine(engine, AUTO, lambda: aligner, Limit(60))
        whole = check(timed.speak(text), "pyttsx3")
    assert [word.text for word in whole.words] == text.split()
    assert {"P", "B"} <= {phone.symbol for phone in whole.phones}


def test_the_voices(engine: Pyttsx3Engine) -> None:
    first, *others = engine.voices()
    assert (first.id, first.language, first.sex, first.installed) == ("gmw/en-us", "en-US", "male", True)
    assert first.licence == "GPL-3.0-or-later"
    assert "en-GB-scotland" in [voice.language for voice in others]
    text = "I can't take a bath at half past nine."
    sounds = [engine.speak(text, voice=voice.id).samples.tobytes() for voice in engine.voices()[:4]]
    assert len(set(sounds)) == 4
    with pytest.raises(NotFound) as unknown:
        engine.speak("hello", voice="nobody")
    assert "gmw/en-us" in unknown.value.advice


def test_speed(engine: Pyttsx3Engine) -> None:
    slow, normal, fast = (engine.speak("It will be fine tomorrow afternoon.", speed=x).duration for x in (0.5, 1, 2))
    assert slow > 1.6 * normal > 2.4 * fast


@pytest.mark.parametrize("text", ["", "...", "?!", "\x00", "\x01"])
def test_nothing_to_say(engine: Pyttsx3Engine, text: str) -> None:
    with pytest.raises(NothingToSay):
        engine.speak(text)


def test_long_and_odd_texts(engine: Pyttsx3Engine) -> None:
    assert engine.speak("and on it went, without an end; " * 30).duration > 40
    plain = engine.speak("150P low").duration
    assert engine.speak("\x01150P low").duration == pytest.approx(plain, rel=0.2)  # no command to change the pitch
    assert engine.speak("a\x00b <speak> [[x]] \ud800 日本").duration > 1


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=40) | st.text(alphabet="aZ09.,:/-$%'\"[]<>()&#@ ½²°|", max_size=40))
def test_anything_at_all(engine: Pyttsx3Engine, text: str) -> None:
    try:
        assert engine.speak(text).duration > 0
    except NothingToSay:
        return


def test_from_several_threads(engine: Pyttsx3Engine) -> None:
    texts = [f"Number {at} says hello." + " And more." * at for at in range(8)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(engine.speak, texts))
    for text, speech in zip(texts, together, strict=True):
        assert speech.duration == pytest.approx(engine.speak(text).duration, abs=0.05)


def test_no_file_is_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    engine = Pyttsx3Engine()
    assert survives_a_kill(engine).duration > 0.3
    assert survives_a_hang(engine, lambda seconds: setattr(engine, "seconds", seconds)).duration > 0.3
    assert list(tmp_path.iterdir()) == []
    engine.close()
    assert engine.process is None
    assert engine.speak("Open again.").duration > 0.3
    engine.close()


def test_without_a_voice_on_the_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without_espeak(tmp_path, monkeypatch)
    engine = create("pyttsx3")
    (voice,) = engine.voices()
    assert not voice.installed
    assert "pip install 'mary[espeak]'" in voice.missing
    with pytest.raises(MissingExtra) as missing:
        engine.speak("Hello.")
    assert "libespeak-ng1" in missing.value.advice
    engine.close()
