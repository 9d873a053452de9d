"""What tests of the running service share: a real server in a process of its own, and curl."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from rtmp_server import RtmpServer

hypothesis.settings.register_profile("mary", deadline=None)  # how long something takes is no test's business
hypothesis.settings.load_profile("mary")

# A shell that runs the tests in the background lets them ignore Ctrl-C, and with them every program they start.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parent.parent
START_SECONDS = 90  # compiled loops are compiled once, by whoever comes first


@dataclass(frozen=True)
class Server:
    """A running `mary serve`."""

    url: str
    process: subprocess.Popen[bytes]
    log: Path
    temporary: Path

    def ready(self) -> bool:
        try:
            with urllib.request.urlopen(f"{self.url}/readyz", timeout=5):
                return True
        except urllib.error.HTTPError as error:
            error.close()
            return False


@contextmanager
def run_server(folder: Path, *, wait: bool = True, **settings: str) -> Iterator[Server]:
    """Start `mary serve` on a free port with the mock voice; settings as MARY_… variables without the prefix."""
    temporary = folder / "tmp"
    temporary.mkdir(parents=True)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MARY_")}
    environment |= {"MARY_SPEECH__ENGINE": "mock", "TMPDIR": str(temporary)}
    environment |= {f"MARY_{name}": value for name, value in settings.items()}
    log = folder / "server.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "app", "serve", "--host", "127.0.0.1", "--port", "0"],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )
        try:
            give_up = time.monotonic() + START_SECONDS
            server: Server | None = None
            while server is None or (wait and not server.ready()):
                if process.poll() is not None or time.monotonic() > give_up:
                    pytest.fail(f"the server did not start:\n{log.read_text()}")
                time.sleep(0.05)
                if server is None and (address := re.search(r"http://127\.0\.0\.1:\d+", log.read_text())):
                    server = Server(address[0], process, log, temporary)
            yield server
        finally:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture(scope="session")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server for the whole session, with its process and its log."""
    with run_server(tmp_path_factory.mktemp("server")) as server:
        yield server


@pytest.fixture(scope="session")
def server(running: Server) -> str:
    """Base URL of a real server with the mock voice; one for the whole session."""
    return running.url


ServerFactory = Callable[..., AbstractContextManager[Server]]


@pytest.fixture
def own_server(tmp_path: Path) -> ServerFactory:
    """`with own_server(LIMITS__TEXT="10") as server:` a server of the test's own, to be ended or set up otherwise."""
    return lambda **settings: run_server(tmp_path / "server", **settings)


@dataclass(frozen=True)
class Answer:
    """What curl got."""

    status: int
    headers: dict[str, str]
    body: bytes

    def json(self) -> Any:
        return json.loads(self.body)


@pytest.fixture
def rtmp_server(tmp_path: Path) -> Iterator[RtmpServer]:
    """A real nginx with its RTMP module, not started yet."""
    reason = RtmpServer.missing()
    if reason:
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)
    server = RtmpServer(tmp_path / "nginx")
    yield server
    server.kill()


Curl = Callable[..., Answer]


@pytest.fixture(scope="session")
def curl_program() -> str:
    program = shutil.which("curl")
    if program is None:
        reason = "curl is not installed: apt-get install curl"
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)
    return program


@pytest.fixture
def curl(curl_program: str, tmp_path: Path) -> Curl:
    """`curl(url, *options)`: one request by the real curl."""

    def run(url: str, *options: str, seconds: float = 60) -> Answer:
        body, headers = tmp_path / "curl.body", tmp_path / "curl.headers"
        body.unlink(missing_ok=True)
        arguments = ["--silent", "--show-error", "--path-as-is", "--max-time", str(seconds), *options]
        if not {"-I", "--head"} & set(options):
            arguments += ["--output", str(body)]
        else:
            arguments += ["--output", os.devnull]
        finished = subprocess.run(
            [curl_program, *arguments, "--dump-header", str(headers), "--write-out", "%{http_code}", url],
            capture_output=True,
            text=True,
            timeout=seconds + 10,
            check=False,
        )
        assert finished.returncode == 0, f"curl {finished.returncode}: {finished.stderr}"
        blocks = headers.read_text().replace("\r", "").strip().split("\n\n")
        lines = [line.partition(":") for line in blocks[-1].splitlines()[1:]]
        return Answer(
            int(finished.stdout),
            {name.lower(): value.strip() for name, _, value in lines},
            body.read_bytes() if body.exists() else b"",
        )

    return run


@pytest.fixture
def free_ports() -> Callable[[int], range]:
    """`free_ports(3)`: UDP ports in a row that nobody uses, below those the system gives out by itself."""

    def find(count: int) -> range:
        for first in range(20_000, 32_000, count):
            with ExitStack() as held:
                try:
                    for port in range(first, first + count):
                        held.enter_context(socket.socket(type=socket.SOCK_DGRAM)).bind(("0.0.0.0", port))
                except OSError:
                    continue
                return range(first, first + count)
        raise AssertionError("no free ports")

    return find
