from dataclasses import replace

import pytest

from app.errors import ConfigError, MissingExtra, NotFound
from app.tts.engine import Voice, check_configured, choose_voice
from app.tts.mock import MockEngine

FIRST = Voice("first", "First", "en", "", 24_000, "MIT", "mock", installed=False, missing="a file")
SECOND = replace(FIRST, id="second", installed=True, missing="")
THIRD = replace(SECOND, id="third")


class Choir(MockEngine):
    def __init__(self, *voices: Voice) -> None:
        self.members = voices

    def voices(self) -> tuple[Voice, ...]:
        return self.members


def test_a_requested_voice_must_exist() -> None:
    assert choose_voice(Choir(FIRST, SECOND), "second", "first") is SECOND
    with pytest.raises(NotFound, match="fourth") as caught:
        choose_voice(Choir(FIRST, SECOND), "fourth")
    assert "first, second" in caught.value.advice


def test_a_requested_voice_must_be_installed() -> None:
    with pytest.raises(MissingExtra, match="first") as caught:
        choose_voice(Choir(FIRST, SECOND, THIRD), "first")
    assert "a file" in caught.value.advice
    assert "second, third" in caught.value.advice
    assert caught.value.field == "voice"
    assert caught.value.status == 422


@pytest.mark.parametrize("voice", ["", "second"])
def test_a_configured_voice_that_can_be_used(voice: str) -> None:
    check_configured(Choir(FIRST, SECOND), voice)


@pytest.mark.parametrize(("voice", "known"), [("secnd", "first, second"), ("first", "a file")])
def test_a_configured_voice_that_cannot(voice: str, known: str) -> None:
    with pytest.raises(ConfigError, match=voice) as caught:
        check_configured(Choir(FIRST, SECOND), voice)
    assert "speech.voice" in caught.value.message
    assert known in caught.value.advice
    assert caught.value.field == "speech.voice"


def test_a_preferred_voice_is_used_if_it_is_installed() -> None:
    choir = Choir(FIRST, SECOND, THIRD)
    assert choose_voice(choir, "", "third") is THIRD
    assert choose_voice(choir, "", "first") is SECOND
    assert choose_voice(choir, "", "of another engine") is SECOND
    assert choose_voice(choir) is SECOND


def test_no_voice_at_all() -> None:
    with pytest.raises(NotFound):
        choose_voice(Choir())
