from __future__ import annotations

import json
import wave
from pathlib import Path

import numpy as np
import pytest

from app.align.given import read_speech
from app.errors import InputError
from app.speech import Phone

RATE = 16_000


@pytest.fixture
def sound(tmp_path: Path) -> Path:
    """Two seconds of a tone."""
    path = tmp_path / "speech.wav"
    samples = (8000 * np.sin(np.arange(2 * RATE) * 0.1)).astype("<i2")
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE)
        file.writeframes(samples.tobytes())
    return path


@pytest.fixture
def written(tmp_path: Path):
    def write(entries: object) -> Path:
        path = tmp_path / "phones.json"
        path.write_text(entries if isinstance(entries, str) else json.dumps(entries))
        return path

    return write


def test_phones_are_made_gapless(sound: Path, written) -> None:
    speech = read_speech(sound, written([["hh", 0.5, 0.6], ["AA1", 0.6, 1.2], ["", 1.2, 1.3], ["M", 1.5, 1.7]]))
    assert speech.rate == RATE
    assert speech.samples.dtype == np.float32
    assert len(speech.samples) == 2 * RATE
    assert 0.2 < np.abs(speech.samples).max() <= 1
    assert speech.phones == (
        Phone("SIL", 0, 0.5),
        Phone("HH", 0.5, 0.6),
        Phone("AA", 0.6, 1.2),
        Phone("SIL", 1.2, 1.3),
        Phone("SIL", 1.3, 1.5),
        Phone("M", 1.5, 1.7),
        Phone("SIL", 1.7, 2.0),
    )


def test_no_phones_are_silence(sound: Path, written) -> None:
    assert read_speech(sound, written([])).phones == (Phone("SIL", 0, 2.0),)


def test_rounding_between_phones_is_no_silence(sound: Path, written) -> None:
    speech = read_speech(sound, written([["AA", 0, 1.0], ["IY", 1.0004, 2.02]]))
    assert speech.phones == (Phone("AA", 0, 1.0), Phone("IY", 1.0, 2.0))


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ("{", "JSON"),
        ({"phones": []}, "list"),
        ([["AA", 0]], "entry 0"),
        ([["AA", 0, 1], "M"], "entry 1"),
        ([["AA", 1, 1]], "entry 0"),
        ([["AA", -1, 1]], "entry 0"),
        ([["QQ", 0, 1]], "QQ"),
        ([["AA", 0, 1], ["M", 0.5, 1.5]], "before"),
        ([["AA", 0, 3]], "3.000"),
    ],
)
def test_wrong_phones_are_explained(sound: Path, written, entries: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_speech(sound, written(entries))


def test_what_is_no_sound_is_explained(tmp_path: Path, written) -> None:
    broken = tmp_path / "broken.wav"
    broken.write_bytes(b"RIFF no, this is not")
    with pytest.raises(InputError, match="cannot be read as sound"):
        read_speech(broken, written([]))
