"""Watching by curl: the bytes are decoded with real codecs."""

from __future__ import annotations

import asyncio
import json
import logging
import socket
import subprocess
import time
import urllib.request
from collections.abc import AsyncIterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import pytest
import uvicorn
from starlette.types import Receive, Scope, Send
from structlog.testing import capture_logs

from app.api import live

FPS = 25
TEXT = "One two three four."


def create(server: str, **order: object) -> dict[str, Any]:
    request = urllib.request.Request(
        f"{server}/v1/streams", json.dumps(order).encode(), {"Content-Type": "application/json"}
    )
    with urllib.request.urlopen(request, timeout=60) as answer:
        return dict(json.load(answer))


def finished_video(server: str, made: dict[str, Any], curl, query: str = "") -> Any:
    give_up = time.monotonic() + 30
    while (answer := curl(server + made["urls"]["video"] + query)).status == 409:
        assert answer.json()["type"] == "/problems/not-ready"
        assert time.monotonic() < give_up
        time.sleep(0.1)
    return answer


def decoded(path: Path) -> tuple[list[float], float]:
    """When each picture of a file is shown, and the seconds of its sound, both decoded to the end."""
    with av.open(str(path)) as container:
        times = [frame.time for frame in container.decode(video=0)]
    with av.open(str(path)) as container:
        sound = container.streams.audio[0]
        samples = sum(frame.samples for frame in container.decode(audio=0))
        return times, samples / sound.rate


def shown_seconds(times: list[float]) -> float:
    """A busy machine leaves late frames out; how long the picture lasts does not change by that."""
    return times[-1] - times[0] + 1 / FPS


@pytest.mark.parametrize(
    ("format", "content_type", "codecs"),
    [("flv", "video/x-flv", ("h264", "aac")), ("mp4", "video/mp4", ("h264", "aac"))],
)
def test_a_live_stream_plays_to_its_end(
    server: str, curl, tmp_path: Path, format: str, content_type: str, codecs: tuple[str, str]
) -> None:
    made = create(server, text=TEXT, once=True)
    assert made["state"] in ("waiting", "idle")
    answer = curl(server + made["urls"][format])  # returns when the stream has ended by itself
    assert answer.status == 200
    assert answer.headers["content-type"] == content_type
    assert answer.headers["cache-control"] == "no-store"
    file = tmp_path / f"live.{format}"
    file.write_bytes(answer.body)
    with av.open(str(file)) as container:
        assert tuple(stream.codec_context.name for stream in container.streams) == codecs
        assert container.streams.video[0].codec_context.width == 512
        assert container.streams.audio[0].rate == 48_000
    times, seconds = decoded(file)
    assert seconds > 1
    assert abs(shown_seconds(times) - seconds) < 0.5
    assert {round(1000 * (after - before)) % 40 for before, after in pairwise(times)} == {0}


def test_ffprobe_reads_a_live_stream(server: str, running, tmp_path: Path) -> None:  # noqa: ARG001
    import os
    import shutil

    program = shutil.which("ffprobe")
    if program is None:
        reason = "ffprobe is not installed: apt-get install ffmpeg"
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)
    made = create(server, text=TEXT, once=True)
    probed = subprocess.run(
        [program, "-v", "error", "-show_entries", "stream=codec_name", "-of", "json", server + made["urls"]["flv"]],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert {stream["codec_name"] for stream in json.loads(probed.stdout)["streams"]} == {"h264", "aac"}


def test_head_does_not_make_a_viewer(server: str, curl) -> None:
    made = create(server, text=TEXT)
    for format, content_type in (("flv", "video/x-flv"), ("mp4", "video/mp4")):
        answer = curl(server + made["urls"][format], "--head")
        assert answer.status == 200
        assert answer.headers["content-type"] == content_type
    report = curl(server + made["urls"]["self"]).json()
    assert report["state"] == "waiting"
    assert report["viewers"] == {"whep": 0, "flv": 0, "mp4": 0, "rtmp": 0, "whip": 0}
    curl(server + made["urls"]["self"], "--request", "DELETE")


def test_viewers_are_counted_and_let_go(server: str, curl, curl_program: str) -> None:
    made = create(server)
    here = server + made["urls"]["self"]
    viewers = [
        subprocess.Popen([curl_program, "-s", "-o", "/dev/null", server + made["urls"][format]])
        for format in ("flv", "flv", "mp4")
    ]
    give_up = time.monotonic() + 20
    while curl(here).json()["viewers"] != {"whep": 0, "flv": 2, "mp4": 1, "rtmp": 0, "whip": 0}:
        assert time.monotonic() < give_up
        time.sleep(0.05)
    for viewer in viewers:
        viewer.terminate()
        viewer.wait(10)
    while curl(here).json()["viewers"] != {"whep": 0, "flv": 0, "mp4": 0, "rtmp": 0, "whip": 0}:
        assert time.monotonic() < give_up
        time.sleep(0.05)
    curl(here, "--request", "DELETE")


def test_a_viewer_who_takes_nothing_harms_nobody(server: str, curl, tmp_path: Path) -> None:
    made = create(server, text=TEXT, once=True, start="viewer")
    host, port = server.removeprefix("http://").split(":")
    with socket.socket() as stuck:
        stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stuck.connect((host, int(port)))
        stuck.sendall(f"GET {made['urls']['flv']} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        answer = curl(server + made["urls"]["flv"])
    file = tmp_path / "live.flv"
    file.write_bytes(answer.body)
    times, _ = decoded(file)
    assert shown_seconds(times) > 1


async def test_a_viewer_who_has_gone_without_saying_so_is_let_go(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(live, "SEND_SECONDS", 0.1)
    let_go = asyncio.Event()

    async def endless() -> AsyncIterator[bytes]:
        try:
            while True:
                yield bytes(1 << 20)
        finally:
            let_go.set()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await live.LiveResponse(endless())(scope, receive, send)

    listener = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(app, log_config=None, lifespan="off", timeout_graceful_shutdown=1))
    with capture_logs() as lines, caplog.at_level(logging.DEBUG):
        serving = asyncio.create_task(server.serve([listener]))
        _, writer = await asyncio.open_connection(*listener.getsockname())  # reads as much as fits its buffer
        writer.write(b"GET / HTTP/1.1\r\nHost: test\r\n\r\n")
        await asyncio.wait_for(let_go.wait(), 30)
        writer.close()
        server.should_exit = True
        await serving
    assert [line["event"] for line in lines] == ["a viewer took nothing and is let go"]
    assert "Traceback" not in caplog.text


def test_the_finished_video_can_be_had_in_pieces(server: str, curl, tmp_path: Path) -> None:
    made = create(server, text=TEXT, start="now")
    assert curl(server + made["urls"]["video"]).status == 409
    whole = finished_video(server, made, curl)
    assert whole.status == 200
    assert whole.headers["content-type"] == "video/mp4"
    assert whole.headers["accept-ranges"] == "bytes"
    file = tmp_path / "video.mp4"
    file.write_bytes(whole.body)
    times, seconds = decoded(file)
    assert seconds > 1
    assert abs(shown_seconds(times) - seconds) < 0.1
    assert whole.body.index(b"moov") < whole.body.index(b"mdat"), "players must be able to start before the end"

    part = curl(server + made["urls"]["video"], "--range", "100-199")
    assert part.status == 206
    assert part.headers["content-range"] == f"bytes 100-199/{len(whole.body)}"
    assert part.body == whole.body[100:200]
    head = curl(server + made["urls"]["video"], "--head")
    assert (head.status, head.headers["content-length"]) == (200, str(len(whole.body)))
    beyond = curl(server + made["urls"]["video"], "--range", f"{len(whole.body)}-")
    assert beyond.status == 416

    named = finished_video(server, made, curl, f"?utterance={made['utterance']['id']}")
    assert named.body == whole.body
    curl(server + made["urls"]["self"], "--request", "DELETE")


def test_events_tell_what_happens(server: str, curl) -> None:
    made = create(server, text="Hi.", once=True, start="viewer")
    here = server + made["urls"]["self"]
    with subprocess.Popen(
        ["curl", "-s", "-N", "-D", "-", server + made["urls"]["events"]], stdout=subprocess.PIPE, text=True
    ) as listener:
        assert listener.stdout is not None
        text = ""
        while "event:" not in text:  # listening before anything happens
            text += listener.stdout.readline()
        curl(server + made["urls"]["mp4"])
        text += listener.stdout.read()
    assert listener.returncode == 0, "events end cleanly with the stream"
    assert "content-type: text/event-stream" in text.lower()
    assert "cache-control: no-store" in text.lower()
    head, _, body = text.replace("\r", "").partition("\n\n")
    assert head.startswith("HTTP/1.1 200")
    events = []
    for block in body.strip().split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.splitlines() if not line.startswith(":"))
        if fields:
            events.append((fields["event"], json.loads(fields["data"])))
    started = next(data for name, data in events if name == "speak_started")
    ended = next(data for name, data in events if name == "speak_ended")
    assert started["utterance"] == ended["utterance"] == made["utterance"]["id"]
    assert started["media_time"] < ended["media_time"]
    assert started["wall_ms"] < ended["wall_ms"]
    assert isinstance(started["loop_frame"], int)
    assert ended["reason"] == "done"
    states = [data["state"] for name, data in events if name == "state"]
    assert states[0] == "waiting"
    assert "speaking" in states
    assert states[-1] == "ended"
    assert curl(here).status in (200, 404, 410)
