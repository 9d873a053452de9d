from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
import pytest
from odd_server import OddServer, odd_server, sends, waits
from test_received_sound import power, tone, wav

from app.errors import ConfigError, NothingToSay, SpeechFailed
from app.tts.engine import SpeechEngine
from app.tts.http_speech import HttpEngine
from app.tts.registry import create

THESIS = sends(wav(tone(8_000, 1_000.0, 1.0), 8_000))
"""What the thesis's server sent: 8 kHz."""


@pytest.fixture
def server() -> Iterator[OddServer]:
    with odd_server(THESIS) as server:
        yield server


@pytest.fixture
def make(server: OddServer) -> Iterator[type[HttpEngine]]:
    made: list[HttpEngine] = []

    def new(path: str = "/", **options: object) -> HttpEngine:
        engine = create("http", {"url": server.url + path, **options})
        assert isinstance(engine, HttpEngine)
        made.append(engine)
        return engine

    yield new  # type: ignore[misc]
    for engine in made:
        engine.close()


def test_the_server_of_the_thesis(make) -> None:
    engine = make()
    assert isinstance(engine, SpeechEngine)
    engine.warm_up()
    speech = engine.speak("Hello there.")
    assert (speech.rate, len(speech.samples), speech.phones, speech.words) == (24_000, 24_000, (), ())
    inside = slice(2_400, -2_400)
    np.testing.assert_allclose(speech.samples[inside], tone(24_000, 1_000.0, 1.0)[inside], atol=0.01)
    loud = power(speech.samples[inside], 24_000, 900, 1_100)
    assert power(speech.samples[inside], 24_000, 4_100, 12_001) < loud - 60


def test_bare_text(server: OddServer, make) -> None:
    make("/tts", voice_parameter="v", parameters={"format": "wav"}).speak("Grüß Gott.")
    (asked,) = server.asked
    assert (asked.method, asked.path, asked.body.decode()) == ("POST", "/tts?format=wav&v=default", "Grüß Gott.")
    assert asked.headers["content-type"] == "text/plain; charset=utf-8"


def test_address(server: OddServer, make) -> None:
    """As MaryTTS takes it."""
    make(
        "/process?INPUT_TYPE=TEXT",
        method="GET",
        parameter="INPUT_TEXT",
        voice_parameter="VOICE",
        voices=["cmu-slt-hsmm"],
        parameters={"OUTPUT_TYPE": "AUDIO", "AUDIO": "WAVE_FILE", "LOCALE": "en_US"},
    ).speak("Rock & roll?")
    (asked,) = server.asked
    assert (asked.method, asked.body) == ("GET", b"")
    assert asked.path == (
        "/process?INPUT_TYPE=TEXT&OUTPUT_TYPE=AUDIO&AUDIO=WAVE_FILE&LOCALE=en_US&VOICE=cmu-slt-hsmm"
        "&INPUT_TEXT=Rock+%26+roll%3F"
    )


def test_form(server: OddServer, make) -> None:
    make(body="form", speed_parameter="rate", headers={"X-Key": "secret"}).speak("One & two.", speed=1.5)
    (asked,) = server.asked
    assert asked.body == b"rate=1.5&text=One+%26+two."
    assert asked.headers["content-type"] == "application/x-www-form-urlencoded"
    assert asked.headers["x-key"] == "secret"


def test_object(server: OddServer, make) -> None:
    """As Piper's own server takes it."""
    engine = make(body="json", voice_parameter="voice", voices=["lessac"], parameters={"a": "b"}, key="k")
    engine.speak("Hello.", voice="lessac")
    (asked,) = server.asked
    assert json.loads(asked.body) == {"text": "Hello.", "voice": "lessac", "a": "b"}
    assert asked.headers["content-type"] == "application/json"
    assert asked.headers["authorization"] == "Bearer k"


def test_a_secret_header_is_not_shown() -> None:
    options = HttpEngine.Options(url="http://localhost", headers={"X-Key": "s3cret"})
    assert "s3cret" not in repr(options)


def test_failures_name_the_engine_and_the_next_sentence_works(server: OddServer, make) -> None:
    engine = make(seconds=1.5)
    for behaviour, said in [(waits, r"no whole answer within 1\.5 s"), (sends(b"oops", "text/html"), "a web page")]:
        server.then(behaviour)
        with pytest.raises(SpeechFailed, match=f"speech engine http: .*{said}"):
            engine.speak("Hello.")
    server.then(THESIS)
    assert engine.speak("Hello.").duration == 1.0
    with pytest.raises(NothingToSay):
        engine.speak("?!")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, r"http\.url"),
        ({"url": "http://localhost", "method": "PUT"}, r"http\.method"),
        ({"url": "http://localhost", "method": "GET", "body": "json"}, "GET has no body"),
        ({"url": "http://localhost", "headers": {"X": "ä"}}, r"http\.headers\.X"),
        ({"url": "http://localhost", "headers": {"X Y": "a"}}, r"http\.headers\.X Y"),
    ],
)
def test_wrong_options_are_named(options: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        create("http", options)
