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
    (counts,) = made.counts()
    assert (counts.engine, counts.times.native, counts.remembered, counts.fallback) == ("mock", 1, 1, 0)


def test_nothing_is_kept_if_the_settings_say_so() -> None:
    made = box(cache_mb=0)
    made.engine.speak("hello")
    made.engine.speak("hello")
    (counts,) = made.counts()
    assert (counts.times.native, counts.remembered) == (2, 0)


def test_an_aligner_and_a_fallback() -> None:
    made = box(aligner="mock", fallback="hibari")
    made.engine.speak("hello")
    first, second = made.counts()
    assert (first.engine, first.times.aligned) == ("mock", 1)
    assert (second.engine, second.times.aligned, second.fallback) == ("hibari", 0, 0)


def test_wrong_options_of_the_aligner_are_told_at_once() -> None:
    settings = Settings.model_validate({"speech": {"engine": "mock"}, "align": {"engine": "textgrid"}})
    with pytest.raises(ConfigError, match=r"align\.aligners\.textgrid\.folder"):
        voicebox(settings.speech, settings.align, Aligners())


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


def test_an_unknown_aligner_has_no_options() -> None:
    settings = Settings.model_validate({"speech": {"engine": "mock"}, "align": {"aligners": {"parrot": {}}}})
    with pytest.raises(ConfigError, match=r"^align\.aligners\.parrot: there is no such aligner"):
        voicebox(settings.speech, settings.align, Aligners())
