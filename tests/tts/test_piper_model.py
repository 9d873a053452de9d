from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from piper_files import ADVICE, described, packaged

from app.errors import SpeechFailed
from app.tts import piper_model
from app.tts.piper_model import PiperModel, read_voice


@pytest.fixture(scope="module")
def model() -> PiperModel:
    path = packaged()
    if path is None:
        pytest.skip(ADVICE)
    return PiperModel(read_voice(path))


def test_what_the_description_says(tmp_path: Path) -> None:
    voice = read_voice(described(tmp_path / "en_GB-cori-high.onnx"))
    assert (voice.name, voice.language, voice.espeak, voice.rate, voice.sex, voice.licence) == (
        "en_GB-cori-high", "en-GB", "en-us", 22_050, "female", ""
    )  # fmt: skip
    assert voice.scales == (0.5, 1.2, 0.7)
    assert (voice.speakers, voice.step) == ({}, 256)
    assert voice.letters("t͡ʃˈiː n̩") == ["t", "ʃ", "ˈ", "i", "ː", " ", "n"]  # what the network does not know is left out


def test_licences_sexes_speakers_and_clusters(tmp_path: Path) -> None:
    (tmp_path / "MODEL_CARD").write_text("* URL: x\n* License: MIT\n")
    symbols = {"_": [0], "^": [1], "$": [2], "a": [3], "ɪ": [4], "aɪ": [5]}
    several = described(
        tmp_path / "en_US-somebody_male-low.onnx",
        num_speakers=2,
        speaker_id_map={"p1": 0, "p2": 1},
        hop_length=512,
        phoneme_id_map=symbols,
        vowel_clusters=[["a", "ɪ"], ["a", "ʊ"]],
    )
    voice = read_voice(several)
    assert (voice.licence, voice.sex, voice.step, voice.speakers) == ("MIT", "male", 512, {"p1": 0, "p2": 1})
    assert voice.letters("aɪaɪɪa") == ["aɪ", "aɪ", "ɪ", "a"]
    assert read_voice(described(tmp_path / "en_US-xyz-low.onnx")).sex == ""


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"audio": {}}, "sample_rate"),
        ({"phoneme_id_map": {"a": [1]}}, r"\$, \^, _"),
        ({"phoneme_type": "pinyin"}, "pinyin"),
        ({"espeak": None}, "TypeError"),
    ],
)
def test_descriptions_that_cannot_be_used(tmp_path: Path, changes: dict[str, object], reason: str) -> None:
    with pytest.raises(SpeechFailed, match=rf"speech engine piper: .*{reason}"):
        read_voice(described(tmp_path / "x.onnx", **changes))


def test_no_description_and_no_network(tmp_path: Path) -> None:
    (tmp_path / "y.onnx").touch()
    with pytest.raises(SpeechFailed, match=r"y\.onnx\.json cannot be used"):
        read_voice(tmp_path / "y.onnx")
    with pytest.raises(SpeechFailed, match=r"x\.onnx cannot be loaded"):
        PiperModel(read_voice(described(tmp_path / "x.onnx")))


def test_durations_span_the_sound(model: PiperModel) -> None:
    letters = model.voice.letters("həlˈoʊ, wˈɜːld.")
    samples, times = model.run(letters, 1.0, 0)
    assert times is not None
    assert len(times) == len(letters) + 2
    assert times[0][0] == 0
    assert all(before[1] == after[0] for before, after in pairwise(times))
    assert times[-1][1] == pytest.approx(len(samples) / model.voice.rate, abs=0.02)
    assert samples.dtype == np.float32
    assert 0.1 < np.abs(samples).max() <= 1.0


def test_speed(model: PiperModel) -> None:
    letters = model.voice.letters("ðə wˈɛðɚ wɪl biː fˈaɪn")
    slow, fast = (len(model.run(letters, speed, 0)[0]) for speed in (0.5, 2.0))
    assert slow > 2 * fast


def test_a_network_that_tells_no_durations(model: PiperModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(piper_model, "outputs_of", lambda *_: ("one", "two"))
    samples, times = PiperModel(model.voice).run(model.voice.letters("həlˈoʊ"), 1.0, 0)
    assert times is None
    assert len(samples) > 2000
