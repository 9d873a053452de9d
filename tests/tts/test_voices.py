from __future__ import annotations

from pathlib import Path

import pytest
from plugin_package import install

from app.tts.registry import names
from app.tts.voices import every_voice


def test_every_engine_is_there_and_says_what_it_lacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch, "mary.tts", "parrot", "app.tts.mock.MockEngine")
    listed = {each.engine: each for each in every_voice({"mock": {"loud": True}})}
    assert tuple(listed) == names()
    assert listed["hibari"].voices[0].id == "heart"
    assert [voice.engine for voice in listed["parrot"].voices] == ["parrot"]
    assert "speech.engines.mock" in listed["mock"].missing
    assert "no_such_library" in listed["lost"].missing
    assert "pip install" in listed["lost"].missing
