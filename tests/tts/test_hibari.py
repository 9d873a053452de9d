import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import hibari
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.align.boundaries import activity
from app.errors import MissingExtra, NotFound, NothingToSay, SpeechFailed
from app.speech import SILENCE, Speech
from app.tts.hibari import RATE, HibariEngine
from app.tts.narrate import check, narrate
from app.tts.take import LEAD, TAIL
from app.tts.text import clean


@pytest.fixture(scope="module")
def engine() -> HibariEngine:
    engine = HibariEngine()
    engine.warm_up()
    engine.warm_up()
    return engine


def phones(speech: Speech) -> str:
    return " ".join(phone.symbol for phone in speech.phones)


def said(speech: Speech, word: str) -> str:
    """Phones of one written word."""
    (found,) = [w for w in speech.words if w.text == word]
    middle = [(p.symbol, (p.start + p.end) / 2) for p in speech.phones if p.symbol != SILENCE]
    return " ".join(symbol for symbol, at in middle if found.start <= at <= found.end)


def test_a_sentence(engine: HibariEngine) -> None:
    text = "Please call Stella, and ask her to bring these things."
    speech = check(engine.speak(text, voice="heart"), "hibari")
    assert phones(speech).startswith("SIL P L IY Z K AO L S T EH L AH SIL AE N D")
    assert speech.rate == RATE
    assert [word.text for word in speech.words] == text.split()
    assert said(speech, "things.") == "TH IH NG Z"
    assert 2.0 < speech.duration < 4.0


def test_silence_at_the_ends_is_short_and_known(engine: HibariEngine) -> None:
    for text in ("Hello there.", "Stop!", "a", "Many birds sing, in the morning"):
        speech = engine.speak(text, voice="heart")
        assert speech.phones[0].symbol == speech.phones[-1].symbol == SILENCE
        assert speech.phones[0].end == pytest.approx(LEAD, abs=1e-4)
        assert speech.duration - speech.phones[-1].start == pytest.approx(TAIL, abs=1e-4)


@pytest.mark.parametrize(
    "text",
    [
        "The birch canoe slid on the smooth planks.",
        "These days a chicken leg is a rare dish.",
        "Rice is often served in round bowls.",
        "She thought for a while, and then she laughed out loud.",
        "Peter Piper picked a peck.",
    ],
)
def test_phones_begin_and_end_with_the_sound(engine: HibariEngine, text: str) -> None:
    speech = engine.speak(text, voice="heart")
    times, loud = activity(speech.samples, speech.rate)
    assert times[loud][0] == pytest.approx(speech.phones[0].end, abs=0.05)
    assert times[loud][-1] == pytest.approx(speech.phones[-1].start, abs=0.05)
    for phone in speech.phones[1:-1]:
        if phone.symbol == SILENCE:
            inside = (times > phone.start + 0.02) & (times < phone.end - 0.02)
            assert loud[inside].mean() < 0.2


def test_the_mouth_is_open_when_it_is_loud(engine: HibariEngine) -> None:
    speech = engine.speak("Bob put a pup, a pup, a pup by Bob.", voice="heart")
    energy = np.convolve(np.square(speech.samples), np.ones(480) / 480, "same")

    def loudness(symbols: str) -> float:
        middles = [round((p.start + p.end) / 2 * RATE) for p in speech.phones if p.symbol in symbols.split()]
        return float(np.median(energy[middles]))

    assert loudness("AA AH UH AY") > 10 * loudness("P B")


def test_numbers_and_titles_belong_to_the_words_as_written(engine: HibariEngine) -> None:
    text = "Dr. Smith paid $3.50 at 10:30 pm on Jan. 5th."
    speech = engine.speak(text, voice="heart")
    assert [word.text for word in speech.words] == text.split()
    assert said(speech, "Dr.") == "D AA K T ER"
    assert said(speech, "$3.50") == "TH R IY D AA L ER Z AE N D F IH F T IY S EH N T S"
    assert said(speech, "10:30") == "T EH N TH ER T IY"
    assert said(speech, "pm") == "P IY EH M"
    assert said(speech, "5th.") == "F IH F TH"


def test_quotes_dashes_and_folded_letters(engine: HibariEngine) -> None:
    speech = engine.speak(clean("“Łódź” – she said – is (quite) nice & old").text, voice="heart")
    words = [word.text for word in speech.words]
    assert words == ['"Łódź"', "she", "said", "is", "(quite)", "nice", "&", "old"]
    assert said(speech, "&") == "AE N D"
    assert said(speech, '"Łódź"').startswith("L ")


def test_the_same_text_makes_the_same_samples(engine: HibariEngine) -> None:
    first, again = (engine.speak("The very same.", voice="heart") for _ in range(2))
    np.testing.assert_array_equal(first.samples, again.samples)
    assert first.phones == again.phones


def test_from_several_threads(engine: HibariEngine) -> None:
    texts = [f"Number {at} says hello to {at + 7}." for at in range(8)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda text: engine.speak(text, voice="heart"), texts))
    for text, speech in zip(texts, together, strict=True):
        np.testing.assert_array_equal(speech.samples, engine.speak(text, voice="heart").samples)


def test_speed(engine: HibariEngine) -> None:
    text = "The weather will be fine tomorrow afternoon."
    slow, normal, fast = (check(engine.speak(text, voice="", speed=speed), "hibari") for speed in (0.5, 1.0, 2.0))
    assert slow.duration > 1.6 * normal.duration > 2.4 * fast.duration
    assert phones(slow).replace("SIL ", "") == phones(fast).replace("SIL ", "")


def test_very_long_texts_and_numbers(engine: HibariEngine) -> None:
    words = "and on it went without an end " * 20
    speech = check(engine.speak(words, voice="heart"), "hibari")
    assert [word.text for word in speech.words] == words.split()
    number = "9" * 180
    speech = check(engine.speak(number, voice="heart"), "hibari")  # more letters than one run of the model takes
    assert phones(speech).replace("SIL ", "").count("N AY N") == 180
    assert [word.text for word in speech.words] == [number]


@pytest.mark.parametrize("text", ["", "...", "?!", '"', "— (", "_", "€"])
def test_nothing_to_say(engine: HibariEngine, text: str) -> None:
    with pytest.raises(NothingToSay):
        engine.speak(text, voice="heart")


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=60) | st.text(alphabet="aZ09.,:/-$%'\"[]()&#@ ½²°", max_size=60))
def test_anything_at_all(engine: HibariEngine, text: str) -> None:
    try:
        speeches = list(narrate(engine, text))
    except NothingToSay:
        return
    words = [word.text for speech in speeches for word in speech.words]
    written = clean(text).text.split()
    assert all(word in written for word in words)


def test_the_voices(engine: HibariEngine, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HIBARI_HOME", str(tmp_path))
    first, *others = engine.voices()
    assert (first.id, first.language, first.sex, first.rate, first.installed, first.missing) == (
        "heart", "en-US", "female", 24_000, True, ""
    )  # fmt: skip
    assert [voice.id for voice in others if voice.installed] == []
    assert all(voice.missing for voice in others)
    with pytest.raises(NotFound) as unknown:
        engine.speak("hello", voice="mock")
    assert "heart" in unknown.value.advice
    with pytest.raises(MissingExtra, match="emma"):
        engine.speak("hello", voice="emma")


def test_another_voice_whose_file_is_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HIBARI_HOME", str(tmp_path))
    shutil.copy(Path(hibari.__file__).parent / "assets/hibari.onnx", tmp_path / "bf_emma.int8.onnx")
    engine = HibariEngine()
    assert {voice.id for voice in engine.voices() if voice.installed} == {"heart", "emma"}
    speech = check(engine.speak("I can't hear her, though.", voice="emma"), "hibari")
    assert said(speech, "can't") == "K AA N T"  # as the British say it


def test_a_model_without_durations_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HIBARI_HOME", str(tmp_path))
    (tmp_path / "bf_emma.int8.onnx").write_bytes(b"")
    with pytest.raises(SpeechFailed, match=r"one tensor of durations.*found 0"):
        HibariEngine().speak("hello", voice="emma")


def test_nothing_is_reported_to_the_maker_of_the_runtime(tmp_path: Path) -> None:
    """The runtime would keep a device id in the home folder and send usage from there."""
    code = "from app.tts.registry import create; create('hibari').speak('Hello.', voice='')"
    environment = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    environment |= {"HOME": str(tmp_path), "TMPDIR": str(tmp_path)}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    assert not [path for path in tmp_path.rglob("*") if "onnxruntime" in str(path)]
