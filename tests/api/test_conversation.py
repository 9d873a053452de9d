"""Conversations over WebSockets, with a real server and a client that is not ours."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import soxr
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from app.api import conversation
from app.api.conversation import MAX_PROBLEMS
from app.client import Mary, Refused
from app.tts.hibari import HibariEngine
from app.tts.mock import MockEngine

PATIENCE = 30


class Client:
    """One side of a conversation, which keeps all it has been told."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.told: list[dict[str, Any]] = []

    def send(self, kind: str, **fields: Any) -> None:
        self.connection.send(json.dumps({"type": kind, **fields}))

    def next(self) -> dict[str, Any]:
        message: dict[str, Any] = json.loads(self.connection.recv(timeout=PATIENCE))
        self.told.append(message)
        return message

    def until(self, kind: str, **fields: Any) -> dict[str, Any]:
        """The next message of this kind, whatever comes before it."""
        while True:
            message = self.next()
            if message["type"] == kind and all(message.get(name) == value for name, value in fields.items()):
                return message

    def named(self, kind: str) -> list[dict[str, Any]]:
        return [message for message in self.told if message["type"] == kind]


@pytest.fixture
def stream(server: str, curl: Any) -> Iterator[str]:
    made = curl(f"{server}/v1/streams", "--json", '{"start": "now"}').json()
    yield made["urls"]["self"]
    curl(server + made["urls"]["self"], "--request", "DELETE")


Open = Callable[..., contextlib.AbstractContextManager[Client]]


@pytest.fixture
def talk(server: str, stream: str) -> Open:
    @contextlib.contextmanager
    def open_one(query: str = "") -> Iterator[Client]:
        with connect(f"{server.replace('http', 'ws')}{stream}/ws{query}") as connection:
            yield Client(connection)

    return open_one


def test_a_text_is_spoken_while_it_is_being_written(talk: Open) -> None:
    with talk() as client:
        assert client.next() == {"type": "state", "state": "idle"}
        for token in ("Hel", "lo the", "re, my good friend", ", how"):
            client.send("text", text=token)
        utterance = client.until("accepted")["utterance"]
        started = client.until("speak_started")  # though the text is not complete
        assert started["utterance"] == utterance
        client.send("text", text=" are you?")
        client.send("end")
        ended = client.until("speak_ended")
        assert (ended["utterance"], ended["reason"]) == (utterance, "done")
        words = client.named("word")
        assert [word["text"] for word in words] == ["Hello", "there,", "my", "good", "friend,", "how", "are", "you?"]
        times = [word["media_time"] for word in words]
        assert times == sorted(times)
        assert started["media_time"] <= times[0] <= times[-1] < ended["media_time"]
        phones = {viseme["phone"] for viseme in client.named("viseme")}
        assert {"HH", "M", "SIL"} <= phones


def test_an_interruption_in_the_middle_of_a_word(talk: Open) -> None:
    with talk("?types=speak_started,speak_ended,word") as client:
        client.send("text", text="Incomprehensibilities, notwithstanding " * 20)
        client.until("word")
        client.send("interrupt")
        ended = client.until("speak_ended")
        assert ended["reason"] == "interrupted"
        client.send("text", text="Again.")
        client.send("end")
        again = client.until("accepted")["utterance"]
        assert client.until("speak_ended", utterance=again)["reason"] == "done"
        assert {message["type"] for message in client.told} == {"accepted", "speak_started", "word", "speak_ended"}


def pcm(rate: int) -> bytes:
    """A buzz that says "papa, papa", 16-bit."""
    speech = MockEngine().speak("papa, papa, papa")
    samples = soxr.resample(speech.samples, speech.rate, rate)
    return (samples * 32767).astype("<i2").tobytes()


@pytest.mark.parametrize("rate", [16_000, 24_000, 48_000])
def test_sound_is_spoken_while_it_is_being_made(talk: Open, rate: int) -> None:
    sound = pcm(rate)
    with talk("?types=speak_started,speak_ended,viseme") as client:
        client.send("audio", rate=rate)
        utterance = client.until("accepted")["utterance"]
        chunk = rate // 50 * 2  # 20 ms
        for at in range(0, len(sound), chunk):
            client.connection.send(sound[at : at + chunk])
        client.until("speak_started")  # though it has not ended
        client.send("end")
        ended = client.until("speak_ended")
        assert (ended["utterance"], ended["reason"]) == (utterance, "done")
        started = client.named("speak_started")[0]
        seconds = len(sound) / 2 / rate
        assert seconds <= ended["media_time"] - started["media_time"] < seconds + 5
        assert client.named("problem") == []
        assert {viseme["phone"] for viseme in client.named("viseme")} > {"SIL"}


def test_sound_with_its_transcript_has_words(talk: Open) -> None:
    speech = HibariEngine().speak("My father bought five big boxes.")
    sound = (speech.samples * 32767).astype("<i2").tobytes()
    with talk("?types=speak_ended,word") as client:
        client.send("audio", rate=24_000, transcript="My father bought five big boxes.")
        for at in range(0, len(sound), 4800):
            client.connection.send(sound[at : at + 4800])
        client.send("end")
        assert client.until("speak_ended")["reason"] == "done"
        words = [word["text"] for word in client.named("word")]
        assert set(words) <= {"My", "father", "bought", "five", "big", "boxes."}
        assert len(words) >= 4


def test_sound_can_be_interrupted_and_what_still_comes_of_it_is_no_mistake(talk: Open) -> None:
    sound = pcm(16_000)
    with talk("?types=speak_started,speak_ended") as client:
        client.send("audio", rate=16_000)
        for _ in range(5):
            client.connection.send(sound)
        client.until("speak_started")
        client.send("interrupt")
        for _ in range(100):
            client.connection.send(sound[:640])
        assert client.until("speak_ended")["reason"] == "interrupted"
        client.send("say", text="Fine.")
        client.until("accepted")
        client.until("speak_ended")
        assert client.named("problem") == []


def test_no_more_live_sounds_than_there_are_places_for(own_server: Any) -> None:
    with (
        own_server(LIMITS__LIVE_SOUNDS="1", ALIGN__RECOGNISER="mock") as server,
        Mary(server.url) as mary,
        mary.stream() as first,
        mary.stream() as second,
        first.conversation("error") as talk,
        second.conversation("error") as other,
    ):
        talk.listen(16_000)
        assert next(iter(talk)).name == "accepted"
        other.listen(16_000)
        with pytest.raises(Refused) as refused:
            next(iter(other))
        assert refused.value.status == 503
        talk.end()
        talk.say("Done.")
        assert next(iter(talk)).name == "accepted"
        other.listen(16_000)
        assert next(iter(other)).name == "accepted"


async def test_what_nobody_goes_on_with_is_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conversation, "FORGOTTEN_SECONDS", 0.05)
    frames: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
    ended = asyncio.Event()

    class Socket:
        receive = staticmethod(frames.get)

    class Feed:
        def flush(self) -> None: ...

        def end(self) -> None:
            ended.set()

    talk = conversation.Conversation(None, None, Socket())  # type: ignore[arg-type]
    talk._feed = Feed()
    listening = asyncio.create_task(talk._listen())
    async with asyncio.timeout(PATIENCE):
        await ended.wait()
    frames.put_nowait({"type": "websocket.disconnect"})  # still listened for
    await asyncio.wait_for(listening, PATIENCE)


def test_wrong_sound_is_explained(talk: Open) -> None:
    with talk("?types=speak_ended") as client:
        client.send("audio", rate=16_000)
        client.until("accepted")
        client.connection.send(b"\x00\x00\x00")  # half a sample too many
        assert client.until("problem")["status"] == 422
        client.send("text", text="And words.")
        assert client.until("problem")["field"] == "type"
        client.send("audio", rate=16_000)
        assert client.until("problem")["field"] == "type"
        for _ in range(14):  # 70 seconds at once
            client.connection.send(bytes(2 * 16_000 * 5))
        assert client.until("problem")["problem"] == "/problems/over-capacity"
        client.send("interrupt")
        assert client.until("speak_ended")["reason"] == "interrupted"


def test_whole_texts_can_be_said_too(talk: Open) -> None:
    with talk("?types=speak_ended") as client:
        client.send("say", text="One. " * 40)
        first = client.until("accepted")
        client.send("say", text="Two \N{SNOWMAN}.", interrupt=True)
        second = client.until("accepted")
        assert second["unread"] == ["\N{SNOWMAN}"]
        assert client.until("speak_ended", utterance=first["utterance"])["reason"] == "interrupted"
        assert client.until("speak_ended", utterance=second["utterance"])["reason"] == "done"


def test_a_flush_does_not_wait_for_the_end_of_the_clause(talk: Open) -> None:
    with talk("?types=word") as client:
        client.send("text", text="Well")
        client.send("flush")
        assert client.until("word")["text"] == "Well"
        client.send("end")


def test_what_cannot_be_read_is_told(server: str, stream: str, talk: Open, curl: Any) -> None:
    with talk("?types=speak_ended") as client:
        client.send("text", text="\N{SNOWMAN} Hello there. And")
        client.send("text", text=" more")
        client.send("end")
        ended = client.until("speak_ended")
        assert ended["reason"] == "done"
        assert client.named("unread") == [
            {"type": "unread", "utterance": ended["utterance"], "unread": ["\N{SNOWMAN}"]}
        ]
    (report,) = curl(server + stream).json()["utterances"]
    assert (report["unread"], report["characters"]) == (["\N{SNOWMAN}"], len("\N{SNOWMAN} Hello there. And more"))


def test_who_hangs_up_has_said_all_there_is(server: str, stream: str, talk: Open, curl: Any) -> None:
    with talk() as client:
        client.send("text", text="Goodbye to everybody")
        utterance = client.until("accepted")["utterance"]
    deadline = time.monotonic() + PATIENCE
    while True:
        report = curl(server + stream).json()["utterances"][-1]
        if report["state"] not in ("queued", "speaking"):
            break
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert (report["id"], report["state"]) == (utterance, "done")


@pytest.mark.parametrize(
    ("frame", "field"),
    [
        (b"\x00\x01", None),
        ("", None),
        ("{", None),
        ("[" * 100_000, None),
        ('{"type": "say", "text": "x", "n": ' + "9" * 5000 + "}", None),
        ("[]", "type"),
        ("null", "type"),
        ('{"text": "Hi"}', "type"),
        ('{"type": "shout"}', "type"),
        ('{"type": ["text"]}', "type"),
        ('{"type": "text"}', "text"),
        ('{"type": "text", "text": 7}', "text"),
        ('{"type": "text", "text": "Hi", "volume": 11}', "volume"),
        ('{"type": "text", "text": "Hi", "voice": "nobody"}', None),
        ('{"type": "text", "text": "Hi", "speed": 9}', "speed"),
        ('{"type": "say", "text": ""}', "text"),
        ('{"type": "flush"}', "type"),
        ('{"type": "end"}', "type"),
        ('{"type": "audio", "rate": 44100}', "rate"),
    ],
)
def test_a_wrong_message_is_explained_and_changes_nothing(talk: Open, frame: str | bytes, field: str | None) -> None:
    with talk("?types=speak_ended") as client:
        client.connection.send(frame)
        problem = client.next()
        assert problem["type"] == "problem"
        assert problem["problem"].startswith("/problems/")
        assert problem["status"] in (404, 413, 422)
        assert problem["detail"]
        if field is not None:
            assert problem["field"] == field
        client.send("say", text="Fine.")
        client.until("accepted")
        assert client.until("speak_ended")["reason"] == "done"


def test_a_wrong_interruption_interrupts_nothing(talk: Open) -> None:
    with talk("?types=speak_started,speak_ended") as client:
        client.send("text", text="Hello there, my good friend, my")
        client.until("speak_started")
        client.send("say", text="\N{SNOWMAN}", interrupt=True)
        assert client.until("problem")["problem"] == "/problems/nothing-to-say"
        client.send("text", text=" old friend.")
        client.send("end")
        assert client.until("speak_ended")["reason"] == "done"
        assert len(client.named("accepted")) == 1


def test_who_sends_nothing_but_wrong_messages_is_let_go(talk: Open) -> None:
    with talk("?types=error") as client:
        for _ in range(MAX_PROBLEMS + 1):
            client.send("shout")
            assert client.next()["type"] == "problem"
        with pytest.raises(ConnectionClosed) as closed:
            client.next()
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1008


def test_a_text_that_others_cut_short_is_told_once(server: str, stream: str, talk: Open, curl: Any) -> None:
    with talk("?types=speak_started,speak_ended") as client:
        client.send("text", text="One thing and another, and another, and another, and")
        client.until("speak_started")
        curl(f"{server}{stream}/interrupt", "--request", "POST")
        client.until("speak_ended")
        for _ in range(100):
            client.send("text", text=" more")
        client.send("end")
        client.send("say", text="Fine.")
        client.until("accepted")
        assert [problem["problem"] for problem in client.named("problem")] == ["/problems/gone"]


def test_a_hundred_tokens_a_second_are_spoken(talk: Open) -> None:
    with talk("?types=speak_ended,word,error") as client:
        for n in range(300):
            client.send("text", text=f" w{n}," if n % 10 == 9 else " ah")
            time.sleep(0.01)
        client.send("interrupt")
        assert client.until("speak_ended")["reason"] == "interrupted"
        assert client.named("problem") == client.named("error") == []


def test_more_text_than_is_kept_is_refused(talk: Open) -> None:
    with talk("?types=speak_ended") as client:
        for _ in range(3):
            client.send("text", text="word " * 1900)
        problem = client.until("problem")
        assert (problem["problem"], problem["status"]) == ("/problems/over-capacity", 503)
        client.send("interrupt")
        client.until("speak_ended")


def test_unknown_streams_and_events_are_refused_before_the_conversation(server: str, stream: str) -> None:
    base = server.replace("http", "ws")
    for path, status in (("/v1/streams/none/ws", 404), (f"{stream}/ws?types=weather", 422)):
        with pytest.raises(InvalidStatus) as refused, connect(base + path):
            pass
        assert refused.value.response.status_code == status
        assert json.loads(refused.value.response.body or b"{}")["status"] == status


def test_the_end_of_the_stream_ends_the_conversation(server: str, stream: str, talk: Open, curl: Any) -> None:
    with talk() as client:
        client.next()
        curl(server + stream, "--request", "DELETE")
        client.until("state", state="ended")
        with pytest.raises(ConnectionClosed) as closed:
            client.next()
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1000
    with pytest.raises(InvalidStatus) as refused, talk():
        pass
    assert refused.value.response.status_code in (404, 410)


def test_a_half_closed_socket_disturbs_nobody(talk: Open) -> None:
    with talk() as client, talk("?types=speak_ended") as other:
        client.next()
        client.send("text", text="Half a sentence and")
        client.until("accepted")
        client.connection.socket.shutdown(socket.SHUT_WR)
        assert other.until("speak_ended")["reason"] == "done"
        other.send("say", text="Fine.")
        assert other.until("speak_ended")["reason"] == "done"
