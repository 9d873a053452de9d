from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from maltreat import survives_a_hang, survives_a_kill, without_espeak
from piper_files import ADVICE, described, packaged

from app.align.boundaries import activity
from app.align.dictionary import NO_LEXICON, Lexicon
from app.align.pocketsphinx import PocketSphinxAligner
from app.errors import ConfigError, MissingExtra, NotFound, NothingToSay, SpeechFailed
from app.speech import PHONES, SILENCE, Speech
from app.tts import piper_model, piper_voice
from app.tts.engine import SpeechEngine
from app.tts.narrate import check
from app.tts.piper_model import VoiceFile, read_voice
from app.tts.piper_voice import PiperEngine
from app.tts.registry import create
from app.tts.take import LEAD, TAIL

pytest.importorskip("espeakng_loader", reason="espeak-ng is not installed: pip install 'mary[espeak]'")


@pytest.fixture(scope="module")
def engine() -> Iterator[PiperEngine]:
    """With a real voice; tests that take it need the extra."""
    if packaged() is None:
        pytest.skip(ADVICE)
    engine = PiperEngine()
    engine.warm_up()
    engine.warm_up()
    yield engine
    engine.close()


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[PiperEngine, VoiceFile]]:
    """Reads texts for a voice without a network."""
    path = described(tmp_path_factory.mktemp("voices") / "en_US-nobody.onnx")
    engine = PiperEngine(PiperEngine.Options(voices=path))
    yield engine, read_voice(path)
    engine.close()


def phones(speech: Speech) -> str:
    return " ".join(phone.symbol for phone in speech.phones if phone.symbol != SILENCE)


def said(speech: Speech, word: str) -> str:
    (found,) = [w for w in speech.words if w.text == word]
    return " ".join(p.symbol for p in speech.phones if found.start <= (p.start + p.end) / 2 <= found.end)


def read(reader: tuple[PiperEngine, VoiceFile], text: str, lexicon: Lexicon = NO_LEXICON) -> list[str]:
    """What the network is given for each run."""
    engine, voice = reader
    runs = engine._read(voice, text, text.split(), lexicon)
    return ["".join(letter.symbol for letter in run) for run in runs]


# --- what the network is given ----------------------------------------------------------------------------------------


def test_stops_and_words(reader: tuple[PiperEngine, VoiceFile]) -> None:
    assert read(reader, "Hello, world — it's (so to say) me; is it? No.") == [
        "həlˈoʊ, wˈɜːld; ɪts sˌoʊ tə sˈeɪ mˌiː; ɪz ɪt? nˈoʊ."
    ]
    engine, voice = reader
    (run,) = engine._read(voice, "The end of the world.", ["The", "end", "of", "the", "world."], NO_LEXICON)
    words = ["".join(letter.symbol for letter in run if letter.word == number) for number in range(5)]
    assert words == ["ðɪ", "ˈɛnd", "ʌv", "ðə", "wˈɜːld"]  # espeak says "of the" as one word


def test_a_lexicon_in_the_networks_letters(reader: tuple[PiperEngine, VoiceFile]) -> None:
    lexicon = {"nguyen": ("W", "IH", "N"), "of": ("AH", "F")}
    assert read(reader, "“Nguyen,” of the Nguyen's!", lexicon) == ["wˈɪn, ˈʌf ðə nˈuːjɛnz!"]
    for symbol in PHONES[:-1]:
        assert read(reader, "xx", {"xx": (symbol,)}) not in ([], [""]), symbol


def test_long_texts_become_several_runs(reader: tuple[PiperEngine, VoiceFile]) -> None:
    text = "And on it went, without an end; " * 20
    runs = read(reader, text.strip())
    assert len(runs) > 3
    assert max(map(len, runs)) < 400
    assert "".join(runs).count("wɪðˌaʊt") + "".join(runs).count("wɪðˈaʊt") == 20


@pytest.mark.parametrize("text", ["", "...", "?!", "—", "\x00"])
def test_nothing_is_given_for_nothing(reader: tuple[PiperEngine, VoiceFile], text: str) -> None:
    assert read(reader, text) == []


def test_the_same_letters_as_pipers_own_reader(reader: tuple[PiperEngine, VoiceFile]) -> None:
    theirs = pytest.importorskip("piper.phonemize_espeak", reason="to compare with it: pip install piper-tts")
    own = theirs.EspeakPhonemizer()
    known = reader[1].symbols
    for text in (
        "Please call Stella, and ask her to bring these things with her from the store.",
        "The soft cushion broke the man's fall.",
        "She thought for a while; and then, without a word, she laughed out loud!",
        "Did Doctor Smith pay $3.50 at 10:30 pm?",
    ):
        expected = "".join(letter for run in own.phonemize("en-us", text) for letter in run if letter in known)
        assert "".join(read(reader, text)).replace(" ", "") == expected.replace(" ", ""), text


# --- sound and times --------------------------------------------------------------------------------------------------


def test_it_is_an_engine(engine: PiperEngine) -> None:
    assert isinstance(engine, SpeechEngine)
    assert isinstance(create("piper"), PiperEngine)


def test_a_sentence(engine: PiperEngine) -> None:
    text = "Please call Stella, and ask her to bring these things — of the store."
    speech = check(engine.speak(text), "piper")
    assert [word.text for word in speech.words] == [word for word in text.split() if word != "—"]
    assert said(speech, "things") == "TH IH NG Z"
    assert said(speech, "of") == "AH V"
    assert speech.phones[0].end == pytest.approx(LEAD, abs=1e-4)
    assert speech.duration - speech.phones[-1].start == pytest.approx(TAIL, abs=1e-4)
    times, loud = activity(speech.samples, speech.rate)
    assert times[loud][0] == pytest.approx(speech.phones[0].end, abs=0.06)
    assert times[loud][-1] == pytest.approx(speech.phones[-1].start, abs=0.06)


def test_the_times_are_where_an_aligner_finds_them(engine: PiperEngine) -> None:
    texts = [
        "The birch canoe slid on the smooth planks.",
        "Help the woman get back to her feet.",
        "A pot of tea helps to pass the evening.",
        "The boy was there when the sun rose.",
    ]
    errors: list[float] = []
    with PocketSphinxAligner() as aligner:
        for text in texts:
            speech = engine.speak(text)
            found = aligner.align(speech.samples, speech.rate, text)
            assert found.confidence > 0.5
            errors += [abs(a.start - b.start) for a, b in zip(found.words, speech.words, strict=True)]
    assert np.median(errors) < 0.030
    assert np.percentile(errors, 90) < 0.080


def test_a_lexicon(engine: PiperEngine) -> None:
    speech = engine.speak("Ask Nguyen, please.", lexicon={"nguyen": ("M", "OW", "B", "AH", "P")})
    assert said(speech, "Nguyen,") == "M OW B AH P"


def test_speed_and_long_texts(engine: PiperEngine) -> None:
    text = "The weather will be fine tomorrow afternoon."
    slow, fast = (check(engine.speak(text, speed=speed), "piper") for speed in (0.5, 2.0))
    assert slow.duration > 2 * fast.duration
    long = "And on it went, without an end; " * 9
    assert [word.text for word in check(engine.speak(long), "piper").words] == long.split()
    with pytest.raises(NothingToSay):
        engine.speak("...")
    assert check(engine.speak("\x01150P a\x00b <b> [[x]] \ud800"), "piper").words


def test_from_several_threads(engine: PiperEngine) -> None:
    texts = [f"Number {at} says hello." for at in range(4)]
    with ThreadPoolExecutor(4) as pool:
        for text, speech in zip(texts, pool.map(engine.speak, texts), strict=True):
            assert [word.text for word in check(speech, "piper").words] == text.split()


def test_a_killed_process_is_replaced(engine: PiperEngine) -> None:
    assert len(survives_a_kill(engine).words) == 2
    engine.close()
    assert engine.process is None
    assert engine.speak("Open again.").words


def test_a_hanging_process_is_ended(engine: PiperEngine) -> None:
    hasty = PiperEngine()
    hasty._models = engine._models
    assert len(survives_a_hang(hasty, lambda seconds: setattr(hasty._espeak, "seconds", seconds)).words) == 2
    hasty.close()


@pytest.mark.usefixtures("engine")
def test_a_network_without_times_goes_to_the_aligner(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(piper_model, "outputs_of", lambda *_: ())
    untimed = PiperEngine()
    speech = untimed.speak("Hello there.")
    assert speech.phones == speech.words == ()
    assert 0.5 < speech.duration < 2
    untimed.close()


# --- voices -----------------------------------------------------------------------------------------------------------


def test_the_packaged_voice(engine: PiperEngine) -> None:
    (voice,) = engine.voices()
    assert (voice.id, voice.language, voice.sex, voice.rate, voice.licence, voice.installed) == (
        "en_US-joe-medium", "en-US", "male", 22_050, "CC0-1.0", True
    )  # fmt: skip
    with pytest.raises(NotFound) as unknown:
        engine.speak("hello", voice="nobody")
    assert "en_US-joe-medium" in unknown.value.advice


def test_voices_from_a_folder(tmp_path: Path) -> None:
    (tmp_path / "more").mkdir()
    described(tmp_path / "en_GB-alba-medium.onnx")
    described(tmp_path / "more" / "en_US-many-low.onnx", num_speakers=2, speaker_id_map={"p1": 0, "p2": 1})
    described(tmp_path / "zh_CN-other.onnx", phoneme_type="pinyin")
    engine = create("piper", {"voices": str(tmp_path)})
    voices = {voice.id: voice for voice in engine.voices()}
    assert list(voices)[:4] == ["en_GB-alba-medium", "en_US-many-low", "en_US-many-low/p1", "en_US-many-low/p2"]
    assert voices["en_GB-alba-medium"].installed
    assert not voices["zh_CN-other"].installed
    assert "pinyin" in voices["zh_CN-other"].missing
    with pytest.raises(SpeechFailed, match="cannot be loaded"):
        engine.speak("Hello.")
    with pytest.raises(SpeechFailed, match="pinyin"):
        engine.speak("Hello.", voice="zh_CN-other")
    engine.close()


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no") as wrong:
        create("piper", {"voices": str(tmp_path / "nowhere")})
    assert wrong.value.field == "speech.engines.piper.voices"
    with pytest.raises(ConfigError, match="voice_folder"):
        create("piper", {"voice_folder": "x"})


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(piper_voice, "PACKAGE", "not_installed_anywhere")
    engine = PiperEngine()
    (voice,) = engine.voices()
    assert not voice.installed
    assert "pip install 'mary[piper]'" in voice.missing
    with pytest.raises(MissingExtra) as missing:
        engine.warm_up()
    assert "pip install 'mary[piper]'" in missing.value.advice
    engine.close()
    without_espeak(tmp_path, monkeypatch)
    engine = PiperEngine(PiperEngine.Options(voices=described(tmp_path / "en_US-x.onnx")))
    assert [voice.installed for voice in engine.voices()] == [False]
    engine.close()
