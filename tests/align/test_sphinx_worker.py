import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from app.worker import read, write

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def process() -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", "app.align.sphinx_worker"]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as running:
        yield running
        running.kill()


def ask(process: subprocess.Popen[bytes], task: str, words: list[list[str]], samples: bytes = b"") -> object:
    assert process.stdin is not None
    assert process.stdout is not None
    write(process.stdin, {"task": task, "words": words}, samples)
    answered = read(process.stdout)
    return answered and answered[0]


def test_failures_are_answered_and_it_goes_on(process: subprocess.Popen[bytes]) -> None:
    noise = (np.random.default_rng(0).standard_normal(16_000) * 100).astype("<i2").tobytes()
    assert ask(process, "hello", []) == {"answer": True}
    assert "no task" in ask(process, "sing", [])["error"]  # type: ignore[index]
    assert "error" in ask(process, "align", [["NO SUCH PHONES"]], noise)  # type: ignore[operator]
    long = [["HH AH L OW"]] * 100
    assert ask(process, "align", long, noise) in (
        {"answer": None},
        {"error": "RuntimeError: Failed to end utterance processing"},
    )
    assert ask(process, "hello", []) == {"answer": True}


def test_it_ends_with_its_input(process: subprocess.Popen[bytes]) -> None:
    assert ask(process, "hello", []) == {"answer": True}
    assert process.stdin is not None
    process.stdin.close()
    assert process.wait(20) == 0
