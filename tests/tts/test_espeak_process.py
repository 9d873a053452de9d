from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from maltreat import without_espeak

from app.errors import MissingExtra, SpeechFailed
from app.tts.espeak_process import EspeakProcess

pytest.importorskip("espeakng_loader", reason="espeak-ng is not installed: pip install 'mary[espeak]'")


@pytest.fixture(scope="module")
def espeak() -> Iterator[EspeakProcess]:
    espeak = EspeakProcess("somebody", 30)
    yield espeak
    espeak.close()


def test_phonemes_know_their_words(espeak: EspeakProcess) -> None:
    uttered = espeak.speak("A big cat.", "gmw/en-US", 1.0)
    assert [(x.ipa.strip("ˈ"), x.position) for x in uttered.phonemes if x.ipa] == [
        ("ɐ", 0), ("b", 2), ("ɪ", 2), ("ɡ", 2), ("k", 6), ("æ", 6), ("t", 6)
    ]  # fmt: skip
    assert all(before.sample <= after.sample for before, after in pairwise(uttered.phonemes))
    assert uttered.samples.dtype == "float32"
    assert 0.1 < abs(uttered.samples).max() <= 1.0
    assert len(espeak.speak("A big cat.", "gmw/en-US", 2.0).samples) < 0.7 * len(uttered.samples)


def test_failures_name_who_asked(espeak: EspeakProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SpeechFailed, match=r"speech engine somebody: espeak-ng: .*no voice"):
        espeak.speak("Hello.", "nobody", 1.0)
    assert espeak.ipa(["hello"], "en-us") == ["həlˈoʊ"]
    assert espeak.pid is not None
    without_espeak(tmp_path, monkeypatch)
    without = EspeakProcess("somebody", 30)
    with pytest.raises(MissingExtra) as missing:
        without.voices()
    assert "pip install 'mary[somebody]'" in missing.value.advice
    without.close()
