"""HTTP-FLV of a running server, with ffplay and byte by byte."""

from __future__ import annotations

import http.client
import os
import shutil
import socket
import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any
from urllib.parse import urlsplit

import pytest

GROUP_SECONDS = 2.0  # stream.keyframe_seconds
WAIT_SECONDS = 60


def create(server: str, curl: Any, order: str) -> dict[str, str]:
    """The addresses of a new stream."""
    answer = curl(f"{server}/v1/streams", "--json", order)
    assert answer.status == 201
    return {name: server + url for name, url in answer.json()["urls"].items()}


class Player:
    """Reads a live FLV in a thread of its own, tag by tag."""

    def __init__(self, url: str) -> None:
        self.tags: list[tuple[int, float, bytes]] = []  # kind, seconds, body
        self.complete = False  # the server said that this was the end
        self._more = threading.Condition()
        address = urlsplit(url)
        connection = http.client.HTTPConnection(address.netloc, timeout=WAIT_SECONDS)
        connection.request("GET", address.path)
        self._socket = connection.sock
        self._answer = connection.getresponse()
        assert self._answer.status == 200
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        with suppress(OSError, http.client.HTTPException):
            assert self._answer.read(13)[:3] == b"FLV"
            while head := self._answer.read(11):
                body = self._answer.read(int.from_bytes(head[1:4], "big"))
                assert int.from_bytes(self._answer.read(4), "big") == 11 + len(body)
                time = int.from_bytes(head[7:8] + head[4:7], "big") / 1000
                with self._more:
                    self.tags.append((head[0], time, body))
                    self._more.notify_all()
            with self._more:
                self.complete = True
                self._more.notify_all()

    def wait(self, condition: Any) -> None:
        with self._more:
            assert self._more.wait_for(condition, WAIT_SECONDS)

    def latest(self) -> float:
        """Seconds on the stream's clock of the last picture."""
        return max(time for kind, time, _ in list(self.tags) if kind == 9)

    def media(self) -> list[tuple[int, float, bytes]]:
        """Without metadata and sequence headers."""
        return [(kind, time, body) for kind, time, body in list(self.tags) if kind in (8, 9) and body[1] == 1]

    def close(self) -> None:
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(WAIT_SECONDS)
        self._answer.close()
        self._socket.close()


@contextmanager
def playing(url: str) -> Iterator[Player]:
    player = Player(url)
    try:
        player.wait(lambda: len(player.media()) > 10)
        yield player
    finally:
        player.close()


@pytest.fixture(scope="module")
def ffplay() -> str:
    program = shutil.which("ffplay")
    if program is None:
        reason = "ffplay is not installed: apt-get install ffmpeg"
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)
    return program


def test_ffplay_plays_it_to_the_end(server: str, curl: Any, ffplay: str) -> None:
    urls = create(server, curl, '{"text": "One two three.", "once": true}')
    command = [ffplay, "-autoexit", "-nodisp", "-loglevel", "info", "-stats", urls["flv"]]
    silent = {**os.environ, "SDL_AUDIODRIVER": "dummy", "SDL_VIDEODRIVER": "dummy"}
    played = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_SECONDS, env=silent, check=True)
    assert "Video: h264 (Constrained Baseline)" in played.stderr
    assert "Audio: aac (LC), 48000 Hz, mono" in played.stderr
    assert "25 tbr" in played.stderr
    assert "rror" not in played.stderr
    assert curl(urls["flv"]).status == 410


def test_a_late_viewer_starts_with_a_key_frame_no_further_back_than_one_group(server: str, curl: Any) -> None:
    urls = create(server, curl, "{}")
    with ExitStack() as players:
        early = players.enter_context(playing(urls["flv"]))
        for joined in (1.0, 2.5, 3.7):
            early.wait(lambda joined=joined: early.latest() > joined)
            before = early.latest()
            late = players.enter_context(playing(urls["flv"]))
            kind, start, body = late.media()[0]
            assert (kind, body[0]) == (9, 0x17)  # a key frame of AVC
            assert start >= before - GROUP_SECONDS - 0.1
            assert abs(next(time for kind, time, _ in late.media() if kind == 8) - start) < 0.1
            # From there on it gets what the other one gets.
            end = late.latest()
            early.wait(lambda end=end: early.latest() >= end)
            known = {(kind, time): body for kind, time, body in early.media()}
            pictures = [(kind, time, body) for kind, time, body in late.media() if kind == 9 and time <= end]
            assert len(pictures) > 1
            assert all(known[kind, time] == body for kind, time, body in pictures)
    curl(urls["self"], "--request", "DELETE")


def test_players_see_the_end_of_a_stream_that_is_deleted(server: str, curl: Any) -> None:
    urls = create(server, curl, "{}")
    with playing(urls["flv"]) as player:
        assert curl(urls["self"], "--request", "DELETE").status == 204
        player.wait(lambda: player.complete)
    gone = curl(urls["flv"])
    assert gone.status == 410
    assert gone.json()["type"] == "/problems/gone"
