import io
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from app.align.sphinx_worker import read, write

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
    write(process.stdin, {"task": task, "words": words, "bytes": len(samples)})
    process.stdin.write(samples)
    process.stdin.flush()
    return read(process.stdout)


def test_messages() -> None:
    pipe = io.BytesIO()
    write(pipe, {"words": ["é"]})
    write(pipe, None)
    pipe.seek(0)
    assert read(pipe) == {"words": ["é"]}
    assert read(pipe) is None
    assert read(pipe) is None  # the end
    assert read(io.BytesIO(b"\0\0\0\x09[1")) is None  # cut off


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
