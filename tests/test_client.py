"""The client against a real server."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import av
import httpx
import pytest

from app.client import HungUp, Mary, Refused, Stream


@pytest.fixture
def mary(server: str) -> Iterator[Mary]:
    with Mary(server) as mary:
        yield mary


def test_a_file(mary: Mary, tmp_path: Path) -> None:
    file = mary.render("Hello there.", tmp_path / "hello.mp4", speed=1.5)
    assert file.parent.joinpath("hello.mp4") == file
    with av.open(str(file)) as container:
        assert {stream.type for stream in container.streams} == {"video", "audio"}
    assert list(tmp_path.iterdir()) == [file]


def test_what_is_refused_says_why_and_leaves_no_file(mary: Mary, tmp_path: Path) -> None:
    with pytest.raises(Refused) as refused:
        mary.render("", tmp_path / "nothing.mp4")
    error = refused.value
    assert (error.status, error.type, error.field) == (422, "/problems/nothing-to-say", "text")
    assert error.advice
    assert str(error) == f"{error.detail} {error.advice}"
    assert list(tmp_path.iterdir()) == []


def saved(stream: Stream, path: Path, utterance: str) -> Path:
    """The video, which is written for a moment after the last word."""
    deadline = time.monotonic() + 30
    while True:
        try:
            return stream.video(path, utterance)
        except Refused as error:
            if error.status != 409 or time.monotonic() > deadline:
                raise
            time.sleep(0.1)


def test_a_session(mary: Mary, tmp_path: Path) -> None:
    with mary.stream(start="now") as stream:
        happening = stream.events("state", "word", "speak_ended")
        assert next(happening).data == {"state": "idle"}  # from now on nothing is missed
        first, second = stream.say("One two."), stream.say("Three.")
        heard = []
        for event in happening:
            heard.append(event)
            if event.name == "speak_ended" and event.data["utterance"] == second:
                break
        assert [event.data["text"] for event in heard if event.name == "word"] == ["One", "two.", "Three."]
        assert {event.data["utterance"] for event in heard if event.name == "speak_ended"} == {first, second}
        captions = stream.captions(second)
        assert captions.startswith("WEBVTT\n\n00:00:00.0")
        assert captions.endswith("Three.\n\n")
        assert saved(stream, tmp_path / "three.mp4", second).stat().st_size > 1000
        stream.say("word " * 50)
        stream.interrupt()
        assert [each["state"] for each in stream.report()["utterances"][:2]] == ["done", "done"]
    with pytest.raises(Refused) as refused:
        stream.say("Too late.")
    assert refused.value.status in (404, 410)
    stream.end()  # does no harm


def test_a_stream_made_with_a_text(mary: Mary) -> None:
    with mary.stream("One two.", start="now") as stream:
        assert stream.utterance == stream.report()["utterances"][0]["id"]
        assert stream.urls["flv"].startswith(mary.url)


def test_a_conversation(mary: Mary) -> None:
    with mary.stream(start="now") as stream, stream.conversation("word", "speak_ended") as talk:
        for token in ("Hel", "lo the", "re, my dear", " friend. ", "Bye"):
            talk.write(token)
        talk.flush()
        talk.end()
        told = []
        for event in talk:
            told.append(event)
            if event.name == "speak_ended":
                break
        words = [event.data["text"] for event in told if event.name == "word"]
        assert words == ["Hello", "there,", "my", "dear", "friend.", "Bye"]
        talk.end()
        with pytest.raises(Refused) as refused:
            next(iter(talk))
        assert (refused.value.status, refused.value.field) == (422, "type")
        talk.say("word " * 50)
        talk.interrupt()
        assert next(event for event in talk if event.name == "speak_ended").data["reason"] == "interrupted"


def test_a_conversation_ends_with_the_stream(mary: Mary) -> None:
    with mary.stream() as stream, stream.conversation() as talk:
        stream.end()
        assert [event.data for event in talk][-1] == {"state": "ended"}
    with pytest.raises(Refused) as refused, stream.conversation():
        pass
    assert refused.value.status in (404, 410)


def test_lists(mary: Mary) -> None:
    assert [voice["id"] for voice in mary.voices()] == ["mock"]
    assert "mary" in [avatar["id"] for avatar in mary.avatars()]


def test_nobody_there() -> None:
    with Mary("http://127.0.0.1:9") as mary, pytest.raises(httpx.ConnectError):
        mary.voices()


def test_a_recording(mary: Mary, tmp_path: Path) -> None:
    voice = mary.render("One two three.", tmp_path / "voice.mp4")
    with mary.stream(start="now") as stream:
        utterance = stream.say_recording(voice, text="One two three.", interrupt=True)
        assert stream.report()["utterances"][-1]["id"] == utterance
        with pytest.raises(Refused) as refused:
            stream.say_recording(__file__)
        assert (refused.value.status, refused.value.field) == (422, "audio")
    file = mary.render_recording(voice, tmp_path / "again.mp4", text="One two three.")
    with av.open(str(file)) as again, av.open(str(voice)) as first:
        assert abs(again.duration - first.duration) < 0.5 * av.time_base  # type: ignore[operator]


def test_pushes(mary: Mary) -> None:
    with mary.stream() as stream:
        push = stream.push("rtmp://127.0.0.1:1/live/key")
        assert [each["id"] for each in stream.pushes()] == [push["id"]]
        stream.end_push(push["id"])
        assert [each["state"] for each in stream.pushes()] == ["ended"]
        with pytest.raises(Refused) as refused:
            stream.push("https://127.0.0.1:1/whip", token="two words")
        assert (refused.value.status, refused.value.field) == (422, "token")


def test_who_is_hung_up_on_is_told_why(mary: Mary) -> None:
    with mary.stream() as stream, stream.conversation("error") as talk:
        with pytest.raises(HungUp) as hung_up:  # noqa: PT012
            while True:
                talk.send(type="shout")
                with pytest.raises(Refused):
                    next(iter(talk))
        assert (hung_up.value.code, hung_up.value.reason) == (1008, "too many messages were wrong")
        with pytest.raises(HungUp):
            talk.say("Hello?")
