from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from maltreat import survives_a_hang, survives_a_kill, without_espeak

from app.align.pocketsphinx import PocketSphinxAligner
from app.errors import ConfigError, MissingExtra, NotFound, NothingToSay
from app.speech import PHONES, SILENCE, Speech
from app.tts.engine import SpeechEngine
from app.tts.espeak import EDGE, EspeakEngine, bcp47, mnemonics
from app.tts.narrate import check, narrate
from app.tts.registry import create
from app.tts.text import clean

pytest.importorskip("espeakng_loader", reason="espeak-ng is not installed: pip install 'mary[espeak]'")


@pytest.fixture(scope="module")
def engine() -> Iterator[EspeakEngine]:
    engine = EspeakEngine()
    engine.warm_up()
    engine.warm_up()
    yield engine
    engine.close()


def phones(speech: Speech) -> str:
    return " ".join(phone.symbol for phone in speech.phones if phone.symbol != SILENCE)


def said(speech: Speech, word: str) -> str:
    """Phones of one written word."""
    (found,) = [w for w in speech.words if w.text == word]
    return " ".join(p.symbol for p in speech.phones if found.start <= (p.start + p.end) / 2 <= found.end)


def test_it_is_an_engine(engine: EspeakEngine) -> None:
    assert isinstance(engine, SpeechEngine)
    assert isinstance(create("espeak"), EspeakEngine)


def test_a_sentence(engine: EspeakEngine) -> None:
    text = "Please call Stella, and ask her to bring these things."
    speech = check(engine.speak(text), "espeak")
    assert phones(speech).startswith("P L IY Z K AO L S T EH L AH AE N D")
    assert [word.text for word in speech.words] == text.split()
    assert said(speech, "things.") == "TH IH NG Z"
    assert speech.phones[0].symbol == speech.phones[-1].symbol == SILENCE
    assert not speech.samples[: round(EDGE * speech.rate)].any()
    pauses = [phone for phone in speech.phones[1:-1] if phone.symbol == SILENCE]
    assert [pause.start for pause in pauses] == [speech.words[2].end]


def test_the_times_are_where_an_aligner_finds_them(engine: EspeakEngine) -> None:
    texts = [
        "The birch canoe slid on the smooth planks.",
        "Help the woman get back to her feet.",
        "A pot of tea helps to pass the evening.",
    ]
    errors: list[float] = []
    with PocketSphinxAligner() as aligner:
        for text in texts:
            speech = engine.speak(text)
            found = aligner.align(speech.samples, speech.rate, text)
            errors += [abs(a.start - b.start) for a, b in zip(found.words, speech.words, strict=True)]
    assert np.median(errors) < 0.020
    assert np.percentile(errors, 90) < 0.060


def test_lips_are_closed_when_it_is_quiet(engine: EspeakEngine) -> None:
    speech = engine.speak("Bob put a pup, a pup, a pup by Bob.")
    energy = np.convolve(np.square(speech.samples), np.ones(220) / 220, "same")

    def loudness(symbols: str) -> float:
        middles = [round((p.start + p.end) / 2 * speech.rate) for p in speech.phones if p.symbol in symbols.split()]
        assert len(middles) >= 4
        return float(np.median(energy[middles]))

    assert loudness("AA AH UH AY") > 10 * loudness("P")


def test_words_that_espeak_says_as_one_are_apart(engine: EspeakEngine) -> None:
    text = "This is the end of the world, as we know it, and in the of the."
    speech = check(engine.speak(text), "espeak")
    assert [word.text for word in speech.words] == text.split()
    assert said(engine.speak("The roof of the house."), "of") == "AH V"
    assert said(engine.speak("The roof, of the house."), "the").startswith("DH")


def test_numbers_titles_and_accents_belong_to_the_words_as_written(engine: EspeakEngine) -> None:
    text = "Dr. Smith paid $3.50 — at 10:30 pm; the “café” (here) took it."
    speech = check(engine.speak(text), "espeak")
    assert [word.text for word in speech.words] == [word for word in text.split() if word != "—"]
    assert said(speech, "Dr.") == "D AA K T ER"
    assert said(speech, "10:30") in ("T EH N TH ER T IY", "T EH N TH ER D IY")  # the flap of American English
    assert said(speech, "“café”") == "K AE F EY"


@pytest.mark.parametrize("text", ["<b>bold</b>", "[[t|S|t]]", "&amp;", "\x01150P low", "a\x00b", "<mark name='x'/>"])
def test_nothing_in_a_text_is_a_command(engine: EspeakEngine, text: str) -> None:
    speech = check(engine.speak(f"{text} and the end."), "espeak")
    assert [word.text for word in speech.words][-3:] == ["and", "the", "end."]
    assert text.split()[0] in [word.text for word in speech.words]
    with_lexicon = engine.speak(f"{text} and the end.", lexicon={"end": ("EH", "N", "D")})
    assert phones(with_lexicon) == phones(speech)


def test_a_lexicon(engine: EspeakEngine) -> None:
    text = "Mr. “Nguyen,” of course; Nguyen's nguyen!"
    speech = check(engine.speak(text, lexicon={"nguyen": ("W", "IH", "N")}), "espeak")
    assert [word.text for word in speech.words] == text.split()
    assert said(speech, "“Nguyen,”") == said(speech, "nguyen!") == "W IH N"
    assert said(speech, "Nguyen's").startswith("N ")
    assert mnemonics(("T", "SH", "AH", "B")) == "[[t|S|'V|b]]"


def test_every_phone_can_be_asked_for(engine: EspeakEngine) -> None:
    every = PHONES[:-1]
    for voice in ("en-us", "en-gb"):
        for symbol in every:
            vowel = symbol[0] in "AEIOU"
            own = ("B", symbol, "B") if vowel else ("B", "EH", symbol)
            speech = engine.speak("xx,", voice=voice, lexicon={"xx": own})
            assert phones(speech).split() == list(own), voice


def test_the_voices(engine: EspeakEngine) -> None:
    voices = {voice.id: voice for voice in engine.voices()}
    first = next(iter(voices.values()))
    assert (first.id, first.language, first.sex, first.rate, first.licence, first.installed) == (
        "en-us", "en-US", "male", 22_050, "GPL-3.0-or-later", True
    )  # fmt: skip
    assert {"en-us", "en-gb", "en-gb-scotland", "en-us+f2"} <= set(voices)
    assert voices["en-gb+f2"].sex == "female"
    assert all(voice.language.startswith("en") for voice in voices.values())
    samples = {voice: engine.speak("The bath is hot.", voice=voice) for voice in voices}
    assert said(samples["en-us"], "hot.") == said(samples["en-us+f2"], "hot.") == "HH AA T"
    assert all(len(check(speech, "espeak").words) == 4 for speech in samples.values())
    with pytest.raises(NotFound) as unknown:
        engine.speak("hello", voice="heart")
    assert "en-gb" in unknown.value.advice


def test_variants_are_chosen_in_the_settings() -> None:
    engine = create("espeak", {"variants": ["Annie"]})
    assert [voice.sex for voice in engine.voices() if voice.id == "en-us+Annie"] == ["female"]
    engine.close()
    engine = create("espeak", {"variants": ["f2", "nobody"]})
    with pytest.raises(ConfigError, match="nobody") as wrong:
        engine.voices()
    assert wrong.value.field == "speech.engines.espeak.variants"
    engine.close()


def test_languages() -> None:
    assert [bcp47(x) for x in ("en", "en-us", "en-029", "en-gb-x-rp", "en-gb-scotland", "en-us-nyc", "en-shaw")] == [
        "en", "en-US", "en-029", "en-GB-x-rp", "en-GB-scotland", "en-US-x-nyc", "en-Shaw"
    ]  # fmt: skip


def test_speed(engine: EspeakEngine) -> None:
    text = "The weather will be fine tomorrow afternoon."
    slow, normal, fast = (check(engine.speak(text, speed=speed), "espeak") for speed in (0.5, 1.0, 2.0))
    assert slow.duration > 1.6 * normal.duration > 2.4 * fast.duration
    assert phones(slow) == phones(normal) == phones(fast)


def test_long_texts(engine: EspeakEngine) -> None:
    text = "and on it went, without an end of the road; " * 60
    speech = check(engine.speak(text), "espeak")
    assert [word.text for word in speech.words] == text.split()


@pytest.mark.parametrize("text", ["", "...", "?!", "—", "\x00", "_"])
def test_nothing_to_say(engine: EspeakEngine, text: str) -> None:
    with pytest.raises(NothingToSay):
        engine.speak(text)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=60) | st.text(alphabet="aZ09.,:/-$%'\"[]<>()&#@ ½²°|", max_size=60))
def test_anything_at_all(engine: EspeakEngine, text: str) -> None:
    with suppress(NothingToSay):
        check(engine.speak(text), "espeak")
    try:
        speeches = list(narrate(engine, text))
    except NothingToSay:
        return
    written = clean(text).text.split()
    assert all(word.text in written for speech in speeches for word in speech.words)


def test_from_several_threads(engine: EspeakEngine) -> None:
    texts = [f"Number {at} says hello of the {at + 7}." for at in range(12)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda text: engine.speak(text, voice="en-gb"), texts))
    for text, speech in zip(texts, together, strict=True):
        assert phones(speech) == phones(engine.speak(text, voice="en-gb"))
        assert [word.text for word in speech.words] == text.split()


def test_a_killed_process_is_replaced() -> None:
    engine = EspeakEngine()
    assert len(survives_a_kill(engine).words) == 2
    engine.close()
    assert engine.process is None
    assert engine.speak("Open again.").words
    engine.close()


def test_a_hanging_process_is_ended() -> None:
    engine = EspeakEngine()
    assert len(survives_a_hang(engine, lambda seconds: setattr(engine._espeak, "seconds", seconds)).words) == 2
    engine.close()


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without_espeak(tmp_path, monkeypatch)
    engine = create("espeak")
    (voice,) = engine.voices()
    assert not voice.installed
    assert "pip install 'mary[espeak]'" in voice.missing
    with pytest.raises(MissingExtra) as missing:
        engine.warm_up()
    assert "pip install 'mary[espeak]'" in missing.value.advice
    engine.close()
