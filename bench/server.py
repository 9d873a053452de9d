"""A real `mary serve` in a process of its own, for benchmarks that measure the service."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any


def fetch(url: str) -> dict[str, Any]:
    """What a GET answers, from JSON."""
    with urllib.request.urlopen(url, timeout=5) as answer:
        return json.load(answer)


@dataclass(frozen=True)
class Server:
    """A running `mary serve`: its address, and its process for whoever measures that."""

    url: str
    process: int

    def resident(self) -> float:
        """Megabytes of memory that it holds."""
        status = Path(f"/proc/{self.process}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+) kB", status)[1]) / 1024

    def threads(self) -> int:
        """How many threads it has."""
        return len(list(Path(f"/proc/{self.process}/task").iterdir()))

    def descriptors(self) -> int:
        """How many files, sockets and the like it has open."""
        return len(list(Path(f"/proc/{self.process}/fd").iterdir()))


@contextmanager
def running_server() -> Iterator[str]:
    """`mary serve` with its real voice, on a free port; its address."""
    with started_server() as server:
        yield server.url


@contextmanager
def started_server() -> Iterator[Server]:
    """`mary serve` with its real voice, on a free port."""
    root = Path(__file__).parent.parent
    command = [sys.executable, "-m", "app", "serve", "--host", "127.0.0.1", "--port", "0"]
    # The service refuses to start with MARY_ variables that it does not know, as those of the benchmarks.
    known = {name: value for name, value in os.environ.items() if not name.startswith("MARY_") or "__" in name}
    process = subprocess.Popen(
        command, cwd=root, env=known, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if address := re.search(r"http://127\.0\.0\.1:\d+", line):
                break
        else:
            raise RuntimeError("the server did not start")
        give_up = time.monotonic() + 60
        while True:
            try:
                fetch(f"{address[0]}/readyz")
                break
            except OSError:
                if time.monotonic() > give_up:
                    raise
                time.sleep(0.1)
        threading.Thread(target=process.stdout.read, daemon=True).start()  # or the pipe fills and the server stops
        yield Server(address[0], process.pid)
    finally:
        process.terminate()
        process.wait(10)
