from dataclasses import replace

import pytest

from app.errors import NotFound
from app.tts.engine import Voice, choose_voice
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
    assert choose_voice(Choir(FIRST, SECOND), "first") is FIRST
    with pytest.raises(NotFound, match="fourth") as caught:
        choose_voice(Choir(FIRST, SECOND), "fourth")
    assert "first, second" in caught.value.advice


def test_a_preferred_voice_is_used_if_it_is_installed() -> None:
    choir = Choir(FIRST, SECOND, THIRD)
    assert choose_voice(choir, "", "third") is THIRD
    assert choose_voice(choir, "", "first") is SECOND
    assert choose_voice(choir, "", "of another engine") is SECOND
    assert choose_voice(choir) is SECOND


def test_no_voice_at_all() -> None:
    with pytest.raises(NotFound):
        choose_voice(Choir())
