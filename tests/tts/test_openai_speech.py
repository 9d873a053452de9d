from __future__ import annotations

import json
import logging
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import uvicorn
from fastapi import FastAPI, Header, HTTPException
from fastapi.responses import StreamingResponse
from odd_server import DRIPPING_BODY, OddServer, closed_port, odd_server, resets, sends, streams
from pydantic import BaseModel
from test_received_sound import RATE, tone, wav

from app import exchange
from app.align.aligners import Aligners
from app.config import AlignSettings, SpeechSettings
from app.errors import ConfigError, NotFound, NothingToSay, SpeechFailed
from app.tts.engine import SpeechEngine
from app.tts.mock import MockEngine
from app.tts.narrate import narrate
from app.tts.openai_speech import OpenAiEngine
from app.tts.registry import create
from app.tts.voicebox import voicebox

GOOD = sends(wav(tone()))


class Order(BaseModel):
    """The body of the protocol's one request."""

    model: str
    input: str
    voice: str
    response_format: str = "mp3"
    speed: float = 1.0
    instructions: str = ""


def service() -> FastAPI:
    """A server as people run it: the mock voice behind the protocol, sent while it is being made."""
    app = FastAPI()
    voice = MockEngine()

    @app.post("/v1/audio/speech")
    def speech(order: Order, authorization: str = Header("")) -> StreamingResponse:
        if authorization != "Bearer sk-right":
            raise HTTPException(401, {"error": {"message": f"Incorrect API key provided: {authorization[7:]}"}})
        if order.voice != "alloy" or order.model != "tts-1":
            raise HTTPException(400, {"error": {"message": "no such voice"}})
        samples = (voice.speak(order.input, speed=order.speed).samples * 32767).astype("<i2").tobytes()
        header = wav(np.zeros(0, np.float32))[:40] + struct.pack("<I", 0xFFFFFFFF)
        start = header if order.response_format == "wav" else b""
        parts = [start, *(samples[at : at + 4_800] for at in range(0, len(samples), 4_800))]
        return StreamingResponse(iter(parts), media_type=f"audio/{order.response_format}")

    return app


@pytest.fixture(scope="module")
def real() -> Iterator[str]:
    server = uvicorn.Server(uvicorn.Config(service(), host="127.0.0.1", port=0, log_level="warning", lifespan="off"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        thread.join(0.01)
        assert thread.is_alive()
    port = server.servers[0].sockets[0].getsockname()[1]
    yield f"http://127.0.0.1:{port}/v1"
    server.should_exit = True
    thread.join(10)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[OddServer]:
    monkeypatch.setattr(exchange, "BACKOFF", 0.01)
    with odd_server(GOOD) as server:
        yield server


@pytest.fixture
def make() -> Iterator[type[OpenAiEngine]]:
    made: list[OpenAiEngine] = []

    def new(**options: object) -> OpenAiEngine:
        engine = create("openai", options)
        assert isinstance(engine, OpenAiEngine)
        made.append(engine)
        return engine

    yield new  # type: ignore[misc]
    for engine in made:
        engine.close()


@pytest.mark.parametrize("form", ["wav", "pcm"])
def test_speaks_by_a_real_server(real: str, make, form: str) -> None:
    engine = make(url=real, key="sk-right", response_format=form)
    engine.warm_up()
    speech = engine.speak("Hello there.", speed=1.25)
    own = MockEngine().speak("Hello there.", speed=1.25)
    assert (speech.rate, speech.phones, speech.words) == (RATE, (), ())
    np.testing.assert_allclose(speech.samples, own.samples, atol=1e-4)


def test_its_speech_gets_phone_times_by_an_aligner(real: str) -> None:
    speech = SpeechSettings(engine="openai", engines={"openai": {"url": real, "key": "sk-right"}}, seconds=60)
    aligners = Aligners()
    box = voicebox(speech, AlignSettings(engine="mock"), aligners)
    pieces = list(narrate(box.engine, "Hello there. And on."))
    box.engine.close()
    aligners.close()
    assert [[word.text for word in piece.words] for piece in pieces] == [["Hello", "there."], ["And", "on."]]
    assert all(piece.phones[-1].end == piece.duration for piece in pieces)
    assert [each.count.aligned for each in box.timed] == [2]


def test_a_wrong_key_is_told_without_the_key(real: str, make) -> None:
    with pytest.raises(
        SpeechFailed, match=r"speech engine openai: .* answered 401 .*“Incorrect API key provided: …”"
    ) as e:
        make(url=real, key="sk-wrong").speak("Hello.")
    assert "key" in e.value.advice


def test_what_is_asked_for(server: OddServer, make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog) -> None:
    (tmp_path / "key").write_text("sk-file\n")
    monkeypatch.setenv("SPEECH_KEY", "sk-environment")
    keys = [{"key": "sk-given"}, {"key_file": tmp_path / "key"}, {"key_env": "SPEECH_KEY"}, {}]
    with caplog.at_level(logging.INFO):
        for key in keys:
            engine = make(url=server.url, model="kokoro", voices=["sky", {"id": "adam", "sex": "male"}], **key)
            assert "sk-" not in repr(engine.Options(**key))
            engine.speak("Grüß Gott.", voice="adam", speed=0.5)
    make(url=f"{server.url}/v1/", instructions="Whisper.").speak("Hello.")
    make(url=f"{server.url}/other/audio/speech").speak("Hello.")
    assert [asked.headers.get("authorization") for asked in server.asked[:4]] == [
        "Bearer sk-given", "Bearer sk-file", "Bearer sk-environment", None,
    ]  # fmt: skip
    assert {asked.path for asked in server.asked[:5]} == {"/v1/audio/speech"}
    assert server.asked[5].path == "/other/audio/speech"
    assert server.asked[0].headers["content-type"] == "application/json"
    assert json.loads(server.asked[0].body) == {
        "model": "kokoro", "input": "Grüß Gott.", "voice": "adam", "response_format": "wav", "speed": 0.5,
    }  # fmt: skip
    assert json.loads(server.asked[4].body)["instructions"] == "Whisper."
    assert not [record for record in caplog.records if "sk-" in record.getMessage() or "Gott" in record.getMessage()]


def test_voices_need_no_server(make) -> None:
    engine = make(
        url=f"http://127.0.0.1:{closed_port()}",
        voices=["sky", {"id": "adam", "name": "Adam", "language": "en-GB", "sex": "male", "licence": "Apache-2.0"}],
    )
    assert isinstance(engine, SpeechEngine)
    sky, adam = engine.voices()
    assert (sky.id, sky.name, sky.language, sky.sex, sky.rate, sky.installed) == ("sky", "sky", "en", "", RATE, True)
    assert (adam.name, adam.language, adam.sex, adam.licence, adam.engine) == (
        "Adam", "en-GB", "male", "Apache-2.0", "openai",
    )  # fmt: skip
    with pytest.raises(NotFound, match="no voice 'eve'") as caught:
        engine.speak("Hello.", voice="eve")
    assert "sky, adam" in caught.value.advice


def test_nothing_to_say(server: OddServer, make) -> None:
    with pytest.raises(NothingToSay):
        make(url=server.url).speak("…")
    assert not server.asked


@pytest.mark.parametrize(
    ("behaviour", "said"),
    [
        (DRIPPING_BODY, "no whole answer within 1.5 s"),
        (sends(b"", status=500), "answered 500 Internal Server Error"),
        (sends(b"", status=429, Retry_After="60"), "429 Too Many Requests; it asks to come back in 60 s"),
        (sends(b'{"status": "fine"}', "application/json"), "sent JSON instead of sound"),
        (sends(b"<html>hi</html>", "text/html"), "sent a web page instead of sound: “hi”"),
        (sends(b""), "sent an empty answer"),
        (sends(wav(np.zeros(RATE, np.float32))), "made no sound"),
        (sends(wav(tone())[:9_000]), "cut off"),
        (sends(b"", status=302, Location="https://elsewhere.example/"), "redirects to https://elsewhere.example/"),
        (resets, "gave no answer"),
    ],
)
def test_a_failure_names_the_engine_and_the_next_sentence_works(server: OddServer, make, behaviour, said: str) -> None:
    engine = make(url=server.url, seconds=1.5 if "1.5 s" in said else 20, retries=1)
    server.then(behaviour)
    with pytest.raises(SpeechFailed, match=f"speech engine openai.*{said}"):
        engine.speak("Hello.")
    server.then(streams([wav(tone())[:1_000], wav(tone())[1_000:]]))
    assert len(engine.speak("Hello.").samples) == len(tone())


def test_nobody_there(make) -> None:
    with pytest.raises(SpeechFailed, match=r"speech engine openai: .* cannot be connected to"):
        make(url=f"http://127.0.0.1:{closed_port()}", retries=0).speak("Hello.")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"url": "localhost:8880"}, "url"),
        ({"url": "ftp://localhost"}, "url"),
        ({"voices": []}, "voices"),
        ({"voices": [{"name": "no id"}]}, "voices.0.*id"),
        ({"response_format": "opus"}, "response_format"),
        ({"seconds": 0}, "seconds"),
        ({"colour": "blue"}, "colour"),
        ({"key": "two\nlines"}, "key"),
        ({"key": "a", "key_env": "B"}, "give one of key and key_env"),
        ({"key_env": "NOT_SET_ANYWHERE"}, "NOT_SET_ANYWHERE is not set"),
        ({"key_file": "/no/such/file"}, "/no/such/file cannot be read"),
    ],
)
def test_wrong_options_are_named(options: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=rf"speech\.engines\.openai.*{said}"):
        create("openai", options)
