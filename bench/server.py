"""A real `mary serve` in a process of its own, for benchmarks that measure the service."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def fetch(url: str) -> dict[str, Any]:
    """What a GET answers, from JSON."""
    with urllib.request.urlopen(url, timeout=5) as answer:
        return json.load(answer)


@contextmanager
def running_server() -> Iterator[str]:
    """`mary serve` with its real voice, on a free port."""
    root = Path(__file__).parent.parent
    command = [sys.executable, "-m", "app", "serve", "--host", "127.0.0.1", "--port", "0"]
    process = subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
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
        yield address[0]
    finally:
        process.terminate()
        process.wait(10)
