"""What callers see of speech engines that fail: the name of the one that did, and that all else goes on."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

ENGINE = """
import os
import time
from dataclasses import replace

import numpy as np

from app.tts.mock import MockEngine


class Moody(MockEngine):
    name = "moody"

    def speak(self, text, **how):
        speech = super().speak(text, **how)
        if "crash" in text:
            raise ZeroDivisionError("out of mood")
        if "hang" in text:
            time.sleep(30)
        if "still" in text:
            return replace(speech, samples=np.zeros_like(speech.samples), phones=(), words=())
        if "noise" in text:
            noise = np.random.default_rng(0).normal(0, 0.1, len(speech.samples)).clip(-1, 1)
            return replace(speech, samples=noise.astype(np.float32), phones=(), words=())
        if "stereo" in text:
            return replace(speech, samples=np.stack([speech.samples] * 2, axis=1))
        if "nothing" in text:
            return replace(speech, samples=speech.samples[:0], phones=(), words=())
        if "quick" in text:
            return replace(speech, rate=48_000)
        return speech
"""

MOODS = {
    "Please crash now.": "speech engine moody failed: ZeroDivisionError",
    "Please hang now.": "speech engine moody took longer than 1 s",
    "Please be still now.": "speech engine moody: it made no sound",
    "Please make a noise now and go on.": "speech engine moody does not say the text",
    "Please be stereo now.": "speech engine moody: samples must be float32 of shape (n,)",
    "Please say nothing now.": "speech engine moody: samples must be float32 of shape (n,)",
    "Please be quick now.": "speech engine moody",
}


@pytest.fixture
def moody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An engine that another package brings."""
    package = tmp_path / "package"
    info = package / "moody-1.0.dist-info"
    info.mkdir(parents=True)
    (package / "moody_engine.py").write_text(ENGINE)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: moody\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[mary.tts]\nmoody = moody_engine:Moody\n")
    monkeypatch.setenv("PYTHONPATH", str(package))


@pytest.mark.usefixtures("moody")
def test_an_engine_that_fails_is_named_and_the_next_sentence_is_spoken(own_server, curl) -> None:
    with own_server(SPEECH__ENGINE="moody", SPEECH__SECONDS="1") as server:

        def said(stream: str, utterance: str) -> Any:
            give_up = time.monotonic() + 60
            while time.monotonic() < give_up:
                utterances = curl(f"{server.url}/v1/streams/{stream}").json()["utterances"]
                found = next(each for each in utterances if each["id"] == utterance)
                if found["state"] in ("done", "failed"):
                    return found
                time.sleep(0.1)
            raise AssertionError("it never ended")

        stream = curl(f"{server.url}/v1/streams", "--json", '{"start": "now"}').json()["id"]
        for text, message in MOODS.items():
            answer = curl(f"{server.url}/v1/render", "--json", f'{{"text": "{text}"}}')
            assert (answer.status, answer.json()["type"]) == (502, "/problems/speech-failed"), text
            assert message in answer.json()["detail"]
        for text, message in list(MOODS.items())[:3]:
            order = f'{{"text": "{text}"}}'
            failed = curl(f"{server.url}/v1/streams/{stream}/say", "--json", order).json()["utterance"]["id"]
            good = curl(f"{server.url}/v1/streams/{stream}/say", "--json", '{"text": "Well."}').json()["utterance"][
                "id"
            ]
            assert message in said(stream, failed)["error"]
            assert said(stream, good)["state"] == "done"


@pytest.mark.usefixtures("moody")
def test_another_engine_speaks_instead(own_server, curl) -> None:
    with own_server(SPEECH__ENGINE="moody", SPEECH__FALLBACK="mock", SPEECH__SECONDS="1") as server:
        answer = curl(f"{server.url}/v1/render", "--json", '{"text": "Please crash now."}')
        assert (answer.status, answer.headers["content-type"]) == (200, "video/mp4")
        counts = {each["engine"]: each for each in curl(f"{server.url}/v1/latency").json()["speech"]}
        assert (counts["moody"]["native"], counts["mock"]["fallback"]) == (0, 1)
