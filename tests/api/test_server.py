"""The end of the service: within three seconds, cleanly, whoever is connected. The bound is part of the interface."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

END_SECONDS = 3.0


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_in_time_with_viewers_connected(own_server, curl, curl_program: str, tmp_path: Path, sent) -> None:
    with own_server() as server:
        made = curl(
            f"{server.url}/v1/streams", "--json", '{"text": "I am in the middle of something.", "start": "now"}'
        )
        urls = made.json()["urls"]
        files = {name: tmp_path / name for name in ("flv", "mp4", "events")}
        viewers = [
            subprocess.Popen([curl_program, "-s", "-N", "-o", str(file), server.url + urls[name]])
            for name, file in files.items()
        ]
        give_up = time.monotonic() + 20
        while not all(file.exists() and file.stat().st_size for file in files.values()):
            assert time.monotonic() < give_up
            time.sleep(0.05)

        asked = time.monotonic()
        server.process.send_signal(sent)
        code = server.process.wait(20)
        took = time.monotonic() - asked

        assert code == 0, server.log.read_text()
        assert took < END_SECONDS
        assert [viewer.wait(10) for viewer in viewers] == [0, 0, 0], "every answer has come to its proper end"
        assert list(server.temporary.iterdir()) == []
        assert "Traceback" not in server.log.read_text()


def test_who_takes_nothing_is_cut_off(own_server, curl) -> None:
    with own_server() as server, socket.socket() as stuck:
        made = curl(f"{server.url}/v1/streams", "--json", "{}").json()
        stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        host, port = server.url.removeprefix("http://").split(":")
        stuck.connect((host, int(port)))
        stuck.sendall(f"GET {made['urls']['flv']} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        time.sleep(1.5)
        asked = time.monotonic()
        server.process.terminate()
        code = server.process.wait(20)
        assert time.monotonic() - asked < END_SECONDS
        assert code == 0, server.log.read_text()


def test_it_can_be_ended_while_it_loads(own_server) -> None:
    with own_server(wait=False, SPEECH__ENGINE="hibari") as server:
        asked = time.monotonic()
        server.process.terminate()
        code = server.process.wait(20)
        assert time.monotonic() - asked < END_SECONDS
        assert code == 0, server.log.read_text()


def test_a_render_in_progress_is_given_up(own_server, curl_program: str) -> None:
    long = "This sentence is said again and again, until the service ends. " * 100
    with own_server() as server:
        caller = subprocess.Popen(
            [curl_program, "-s", "-o", "/dev/null", f"{server.url}/v1/render", "--json", f'{{"text": "{long}"}}']
        )
        give_up = time.monotonic() + 20
        while not list(server.temporary.glob("mary-render-*")):
            assert time.monotonic() < give_up
            time.sleep(0.02)
        asked = time.monotonic()
        server.process.terminate()
        code = server.process.wait(20)
        assert time.monotonic() - asked < END_SECONDS
        assert code == 0, server.log.read_text()
        caller.wait(10)
        assert list(server.temporary.iterdir()) == []


def run_serve(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    import os

    return subprocess.run(
        [sys.executable, "-m", "app", "serve", "--host", "127.0.0.1", *arguments],
        cwd=Path(__file__).resolve().parents[2],
        env={**os.environ, "MARY_SPEECH__ENGINE": "mock", **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_a_port_in_use_is_said_plainly() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        ended = run_serve("--port", str(port))
    assert ended.returncode == 2
    assert f"cannot listen on 127.0.0.1:{port}" in ended.stderr
    assert "MARY_SERVER__PORT" in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize(
    ("setting", "value", "words"),
    [
        ("MARY_SPEECH__ENGINE", "parrot", "parrot"),
        ("MARY_AVATARS__FOLDER", "/nowhere", "avatar"),
        ("MARY_AVATARS__DEFAULT", "nobody", "nobody"),
    ],
)
def test_what_cannot_be_loaded_ends_the_service_with_a_reason(setting: str, value: str, words: str) -> None:
    ended = run_serve("--port", "0", **{setting: value})
    assert ended.returncode == 2
    assert words in ended.stderr
    assert "Traceback" not in ended.stderr
