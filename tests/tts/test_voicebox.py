from __future__ import annotations

from typing import Any

import pytest

from app.align.aligners import Aligners
from app.config import Settings
from app.errors import ConfigError
from app.tts.voicebox import Voicebox, voicebox


def box(**speech: Any) -> Voicebox:
    settings = Settings.model_validate({"speech": {"engine": "mock", **speech}, "align": {"engine": "mock"}})
    return voicebox(settings.speech, settings.align, Aligners())


def test_the_engine_of_the_settings() -> None:
    made = box()
    assert made.engine.name == "mock"
    made.engine.speak("hello")
    made.engine.speak("hello")
    assert made.counts()["mock"].native == 1
    assert made.caches[0].hits == 1
    assert made.fallback is None


def test_nothing_is_kept_if_the_settings_say_so() -> None:
    made = box(cache_mb=0)
    made.engine.speak("hello")
    made.engine.speak("hello")
    assert (made.counts()["mock"].native, made.caches) == (2, ())


def test_an_aligner_and_a_fallback() -> None:
    made = box(aligner="mock", fallback="hibari")
    made.engine.speak("hello")
    assert made.counts()["mock"].aligned == 1
    assert made.fallback is made.engine
    assert list(made.counts()) == ["mock", "hibari"]


@pytest.mark.parametrize(
    ("speech", "field"),
    [
        ({"engine": "parrot"}, "speech.engine"),
        ({"fallback": "parrot"}, "speech.fallback"),
        ({"aligner": "parrot"}, "speech.aligner"),
        ({"engines": {"parrot": {}}}, "speech.engines.parrot"),
        ({"engines": {"mock": {"loud": True}}}, "speech.engines.mock"),
    ],
)
def test_what_is_unknown_is_refused_with_its_key(speech: dict[str, Any], field: str) -> None:
    with pytest.raises(ConfigError, match=f"^{field}: ") as caught:
        box(**speech)
    assert caught.value.field == field
    assert caught.value.advice
