"""A client of the service for Python programs: files, live streams, and conversations.

    from app.client import Mary

    with Mary("http://localhost:8080") as mary, mary.stream(start="now") as stream:
        stream.say("Hello, I am Mary.")
        for event in stream.events("word", "speak_ended"):
            print(event)

Nothing of the service itself is imported. Every refusal is a `Refused`, which says what was wrong and what to do; a
conversation that the service breaks off ends with `HungUp`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import httpx
from websockets.exceptions import ConnectionClosed, ConnectionClosedOK, InvalidStatus
from websockets.sync.client import ClientConnection, connect

SECONDS = 60.0
"""How long an answer may take; what is watched or listened to has no limit."""


class Refused(Exception):
    """The service said no (RFC 9457).

    Attributes:
        status: of HTTP.
        type: what kind of problem, "/problems/not-found".
        detail: what was wrong.
        advice: what to do, or "".
        field: the offending field of the request, or "".
    """

    def __init__(self, status: int, document: dict[str, Any]) -> None:
        self.status = status
        self.type = str(document.get("problem") or document.get("type", ""))
        self.detail = str(document.get("detail") or f"the service answered {status}")
        self.advice = str(document.get("advice", ""))
        self.field = str(document.get("field", ""))
        super().__init__(f"{self.detail} {self.advice}".strip())


class HungUp(Exception):
    """A conversation was broken off, or had ended already.

    Attributes:
        code: of RFC 6455, 7.4.1: 1008 after too many wrong messages, 1013 from a service that is full, 1006 if the
            connection was lost, 1000 if the stream had ended.
        reason: in the service's words, or "".
    """

    def __init__(self, error: ConnectionClosed) -> None:
        self.code = int(error.rcvd.code) if error.rcvd else 1006
        self.reason = error.rcvd.reason if error.rcvd else ""
        super().__init__(f"the conversation has ended: {self.reason or 'no reason given'} ({self.code})")


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened on a stream: `state`, `speak_started`, `word`, `viseme`, `speak_ended`, `error`, …"""

    name: str
    data: dict[str, Any] = field(default_factory=dict)


class Mary:
    """The service at an address. A context manager; to be closed.

    Raises:
        Refused: what the service does not do, by all methods here and of `Stream` and `Conversation`.
        httpx.TransportError: it cannot be reached.
    """

    def __init__(self, url: str = "http://localhost:8080") -> None:
        self.url = url.rstrip("/")
        self._http = httpx.Client(base_url=self.url, timeout=SECONDS)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the connections back."""
        self._http.close()

    def voices(self) -> list[dict[str, Any]]:
        """What can be spoken with."""
        return list(self.call("GET", "/v1/voices")["voices"])

    def avatars(self) -> list[dict[str, Any]]:
        """Who can speak."""
        return list(self.call("GET", "/v1/avatars")["avatars"])

    def render(self, text: str, path: str | os.PathLike[str], **options: Any) -> Path:
        """Have a text spoken into an MP4 file; `options` are those of `POST /v1/render`. No half of a file is left."""
        with self._http.stream("POST", "/v1/render", json={"text": text, **options}, timeout=None) as answer:
            return _save(answer, Path(path))

    def render_recording(self, recording: str | os.PathLike[str], path: str | os.PathLike[str], **options: Any) -> Path:
        """Have a recording spoken into an MP4 file; `options`: text, strict, avatar."""
        with (
            Path(recording).open("rb") as audio,
            self._http.stream("POST", "/v1/render", files={"audio": audio}, data=options, timeout=None) as answer,
        ):
            return _save(answer, Path(path))

    def stream(self, text: str | None = None, **options: Any) -> Stream:
        """A new live stream, as a context manager that ends it; `options` are those of `POST /v1/streams`."""
        order = options if text is None else {"text": text, **options}
        return Stream(self, self.call("POST", "/v1/streams", order))

    def call(self, method: str, path: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
        """Any call with JSON both ways; an answer without a body is empty."""
        return _json(self._http.request(method, path, json=body))

    def upload(self, path: str, recording: str | os.PathLike[str], **options: Any) -> dict[str, Any]:
        """Send a recording, with other fields of the form; what a long one takes to be understood is waited for."""
        with Path(recording).open("rb") as audio:
            return _json(self._http.post(path, files={"audio": audio}, data=options, timeout=None))

    def lines(self, path: str) -> Iterator[str]:
        """The lines of an answer that goes on."""
        with self._http.stream("GET", path, timeout=httpx.Timeout(SECONDS, read=None)) as answer:
            _check(answer)
            yield from answer.iter_lines()

    def download(self, address: str, path: str | os.PathLike[str]) -> Path:
        """Save what is at an address of the service. Nothing half-written is left."""
        with self._http.stream("GET", address) as answer:
            return _save(answer, Path(path))


class Stream:
    """A live stream. A context manager that ends it.

    Attributes:
        id: the key to it.
        urls: absolute addresses by what is there: self, whep, flv, mp4, video, captions, events, ws.
        utterance: id of what it was made to say, or "".
    """

    def __init__(self, mary: Mary, made: dict[str, Any]) -> None:
        self.id = str(made["id"])
        self.urls = {name: mary.url + path for name, path in made["urls"].items() if path and path.startswith("/")}
        self.utterance = str(made["utterance"]["id"]) if made.get("utterance") else ""
        self._mary = mary
        self._here = str(made["urls"]["self"])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def say(self, text: str, **options: Any) -> str:
        """Queue a text; returns its utterance. `options` are those of `POST …/say`: interrupt, voice and so on."""
        return str(self._mary.call("POST", f"{self._here}/say", {"text": text, **options})["utterance"]["id"])

    def say_recording(self, recording: str | os.PathLike[str], **options: Any) -> str:
        """Queue a sound file; returns its utterance. `options` are those of `POST …/audio`: text, strict, interrupt."""
        return str(self._mary.upload(f"{self._here}/audio", recording, **options)["utterance"]["id"])

    def push(self, url: str, *, token: str | None = None) -> dict[str, Any]:
        """Push it to an RTMP or WHIP server, too; returns the push: id, target, state, … `token` is for WHIP."""
        order = {"url": url} if token is None else {"url": url, "token": token}
        return self._mary.call("POST", f"{self._here}/pushes", order)

    def pushes(self) -> list[dict[str, Any]]:
        """The pushes and how they are doing."""
        return list(self.report()["pushes"])

    def end_push(self, push: str) -> None:
        """End the push with this id; the stream goes on."""
        self._mary.call("DELETE", f"{self._here}/pushes/{push}")

    def interrupt(self) -> None:
        """Fall silent within two frames."""
        self._mary.call("POST", f"{self._here}/interrupt")

    def report(self) -> dict[str, Any]:
        """How it is doing."""
        return self._mary.call("GET", self._here)

    def end(self) -> None:
        """End it; also if it has ended by itself."""
        try:
            self._mary.call("DELETE", self._here)
        except Refused as error:
            if error.status != httpx.codes.NOT_FOUND:
                raise

    def events(self, *names: str) -> Iterator[Event]:
        """What happens from the first iteration on until the stream ends; `names` of the events wanted, all if none."""
        name, data = "", []
        for line in self._mary.lines(f"{self._here}/events?types={','.join(names)}"):
            key, _, value = line.partition(": ")
            if key == "event":
                name = value
            elif key == "data":
                data.append(value)
            elif not line and name:
                yield Event(name, json.loads("\n".join(data)))
                name, data = "", []

    def captions(self, utterance: str = "") -> str:
        """What was said so far, as WebVTT."""
        query = f"?utterance={utterance}" if utterance else ""
        return "\n".join(self._mary.lines(f"{self._here}/captions.vtt{query}")) + "\n"

    def video(self, path: str | os.PathLike[str], utterance: str = "") -> Path:
        """Save the finished file of an utterance, by default of the last; refused (409) while it is being made."""
        return self._mary.download(f"{self._here}/video.mp4" + (f"?utterance={utterance}" if utterance else ""), path)

    @contextmanager
    def conversation(self, *names: str) -> Iterator[Conversation]:
        """Talk with it while the text is being written; `names` of the events wanted, all if none."""
        address = "ws" + self._mary.url.removeprefix("http") + f"{self._here}/ws?types={','.join(names)}"
        try:
            connection = connect(address, open_timeout=SECONDS)
        except InvalidStatus as error:
            raise Refused(error.response.status_code, _document(error.response.body)) from error
        with connection:
            yield Conversation(connection)


class Conversation:
    """What goes in while it is being made; iterate it for what happens. Made by `Stream.conversation`.

    Raises:
        HungUp: the service has broken it off, by all methods.
    """

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection

    def write(self, text: str) -> None:
        """More of a text: the tokens of a language model, say."""
        self.send(type="text", text=text)

    def flush(self) -> None:
        """Speak what has come so far without waiting for the end of its clause."""
        self.send(type="flush")

    def end(self) -> None:
        """The text or the sound is complete."""
        self.send(type="end")

    def interrupt(self) -> None:
        """Fall silent, and forget what was begun."""
        self.send(type="interrupt")

    def say(self, text: str, *, interrupt: bool = False) -> None:
        """A whole text."""
        self.send(type="say", text=text, interrupt=interrupt)

    def listen(self, rate: int, transcript: str | None = None) -> None:
        """Sound follows, by `hear`: so many samples a second, and what is said in it if that is known."""
        self.send(type="audio", rate=rate, **({} if transcript is None else {"transcript": transcript}))

    def hear(self, samples: bytes) -> None:
        """Some sound: 16-bit little-endian mono."""
        self._send(samples)

    def send(self, **message: Any) -> None:
        """Any message."""
        self._send(json.dumps(message))

    def _send(self, message: str | bytes) -> None:
        try:
            self._connection.send(message)
        except ConnectionClosed as error:
            raise HungUp(error) from error

    def __iter__(self) -> Iterator[Event]:
        """Everything that is told, until the stream ends: events, `accepted` and `unread`.

        Raises:
            Refused: a message was wrong. The conversation goes on: iterate again.
        """
        while True:
            try:
                told = json.loads(self._connection.recv())
            except ConnectionClosedOK:
                return
            except ConnectionClosed as error:
                raise HungUp(error) from error
            if told["type"] == "problem":
                raise Refused(int(told["status"]), told)
            yield Event(told.pop("type"), told)


def _check(answer: httpx.Response) -> None:
    if answer.is_success:
        return
    answer.read()
    raise Refused(answer.status_code, _document(answer.content))


def _json(answer: httpx.Response) -> dict[str, Any]:
    _check(answer)
    return dict(answer.json()) if answer.content else {}


def _document(body: bytes | bytearray | None) -> dict[str, Any]:
    try:
        document = json.loads(body or b"")
    except ValueError:
        return {}
    return document if isinstance(document, dict) else {}


def _save(answer: httpx.Response, path: Path) -> Path:
    _check(answer)
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("wb") as file:
            for chunk in answer.iter_bytes():
                file.write(chunk)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return path
