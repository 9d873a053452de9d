import re
from pathlib import Path
from typing import Any

import pytest
from plugin_package import install

from app.errors import MissingExtra, NotFound, SpeechFailed
from app.tts.engine import SpeechEngine
from app.tts.narrate import narrate
from app.tts.registry import create, names


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch, "mary.tts", "parrot", "app.tts.mock.MockEngine")


@pytest.mark.parametrize("name", ["hibari", "espeak", "piper", "pyttsx3", "openai", "mock"])
def test_ours(name: str) -> None:
    engine = create(name)
    assert isinstance(engine, SpeechEngine)
    assert engine.name == name
    assert engine.voices()
    engine.close()


def test_unknown_names_the_known() -> None:
    with pytest.raises(NotFound, match="nobody") as caught:
        create("nobody")
    assert "hibari, espeak, piper, pyttsx3, openai, http, mock" in caught.value.advice


@pytest.mark.usefixtures("plugin")
def test_entry_points() -> None:
    assert names() == ("hibari", "espeak", "piper", "pyttsx3", "openai", "http", "mock", "lost", "parrot", "stone")
    assert create("parrot").speak("hello", voice="mock").words[0].text == "hello"


@pytest.mark.usefixtures("plugin")
def test_bad_entry_points() -> None:
    with pytest.raises(SpeechFailed, match="Stone lacks voices, warm_up, speak"):
        create("stone")
    with pytest.raises(MissingExtra, match="no_such_library"):
        create("lost")


def test_the_engine_in_the_documentation_works() -> None:
    page = (Path(__file__).parents[2] / "docs/speech.md").read_text("utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    made: dict[str, Any] = {}
    exec(example, made)
    engine = made["Hummer"]()
    assert isinstance(engine, SpeechEngine)
    assert [len(speech.words) for speech in narrate(engine, "Hum this. And that too!")] == [2, 3]
