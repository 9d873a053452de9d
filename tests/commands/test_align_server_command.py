"""`mary align-server`, run as people run it: in a process of its own."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from app.align.registry import create
from app.commands.align_server import run
from app.errors import AlignmentFailed, InputError

ROOT = Path(__file__).resolve().parents[2]
RATE = 16_000
SOUND = (0.3 * np.sin(np.arange(RATE) * 0.1)).astype(np.float32)


@contextmanager
def align_server(*options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The process and its address."""
    process = subprocess.Popen(
        [sys.executable, "-m", "app", "align-server", "--aligner", "mock", *options],
        cwd=ROOT,
        env={name: value for name, value in os.environ.items() if not name.startswith("MARY_")},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.fullmatch(r"mock: (http://127\.0\.0\.1:(\d+)/RPC2)\n", line)
        assert found, line
        yield process, found[1]
    finally:
        process.kill()
        process.communicate()


def test_serves_ends_and_comes_back() -> None:
    with align_server("--port", "0") as (process, url):
        aligner = create("xmlrpc", {"url": url, "seconds": 60})
        assert [word.text for word in aligner.align(SOUND, RATE, "Hello there.").words] == ["Hello", "there."]
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
        with pytest.raises(AlignmentFailed, match=r"aligner xmlrpc: .* cannot be connected to"):
            aligner.align(SOUND, RATE, "Hello there.")
    port = url.rpartition(":")[2].removesuffix("/RPC2")
    with align_server("--port", port) as (process, again):
        assert again == url
        assert aligner.align(SOUND, RATE, "Hello there.").words
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
    aligner.close()  # type: ignore[attr-defined]


def test_it_does_not_ask_itself() -> None:
    with pytest.raises(InputError, match="xmlrpc only asks"):
        run("xmlrpc", {}, host="127.0.0.1", port=0, workers=1, out=Console())
