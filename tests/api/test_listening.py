from __future__ import annotations

import io
import wave

import numpy as np
import pytest

from app.align.aligners import Aligners
from app.api.listening import Listening
from app.config import Settings
from app.errors import ConfigError, InputError, OverCapacity


def listening(**sections: dict[str, object]) -> Listening:
    chosen: dict[str, object] = {"align": {"engine": "mock", "recogniser": "mock"}}
    return Listening(Settings.model_validate(chosen | sections), Aligners())


def recording(seconds: float = 1.0) -> io.BytesIO:
    file = io.BytesIO()
    with wave.open(file, "wb") as sound:
        sound.setnchannels(1)
        sound.setsampwidth(2)
        sound.setframerate(16_000)
        sound.writeframes((8000 * np.sin(np.arange(round(seconds * 16_000)) * 0.1)).astype("<i2").tobytes())
    file.seek(0)
    return file


async def test_a_text_is_aligned_and_without_one_phones_are_heard() -> None:
    ears = listening()
    with_text = await ears.recording(recording(), "hello you", strict=False, lexicon={"you": "Y AE"})
    assert [word.text for word in with_text.speech.words] == ["hello", "you"]
    assert "AE" in {phone.symbol for phone in with_text.speech.phones}
    alone = await ears.recording(recording(), "  ", strict=False, lexicon={})
    assert alone.speech.words == ()
    assert alone.confidence is None


async def test_live_sound_is_made_with_the_limits_of_the_settings() -> None:
    sound = await listening(limits={"live_audio_seconds": 2}).live(24_000, "hello")
    sound.push_audio(np.zeros(24_000, np.float32))
    with pytest.raises(OverCapacity, match="2 s"):
        sound.push_audio(np.zeros(48_000, np.float32))
    with pytest.raises(InputError):
        await listening().live(44_100)


@pytest.mark.parametrize("key", ["engine", "recogniser"])
def test_an_unknown_one_is_refused_at_once(key: str) -> None:
    chosen = {"engine": "mock", "recogniser": "mock", key: "parrot"}
    with pytest.raises(ConfigError, match=f"align.{key}: there is no 'parrot'"):
        listening(align=chosen).check()
    listening().check()
