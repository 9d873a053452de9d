"""A conversation of half an hour, on a clock that runs fast: sound and picture stay in step, and nothing piles up."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

MINUTES = 30
SPEED = 30
FRAME = 0.04
HERE = Path(__file__).resolve().parent


@pytest.fixture(scope="module")
def session() -> dict[str, Any]:
    finished = subprocess.run(
        [sys.executable, HERE / "long_session.py", str(MINUTES), str(SPEED), "1"],
        capture_output=True,
        text=True,
        timeout=600,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE), str(HERE.parents[1])])},
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    assert "Traceback" not in finished.stderr, finished.stderr
    result: dict[str, Any] = json.loads(finished.stdout)
    return result


@pytest.mark.timeout(620)
def test_hundreds_of_utterances_end_as_they_should(session: dict[str, Any]) -> None:
    assert session["said"] > 300
    assert session["interrupted"] > 50
    assert "failed" not in session["states"]
    assert {"done", "interrupted"} <= set(session["states"])  # the last one may be going on


@pytest.mark.parametrize("viewer", ["flv", "mp4"])
def test_sound_and_picture_are_in_step_from_the_first_minute_to_the_last(session: dict[str, Any], viewer: str) -> None:
    seen = session["viewers"][viewer]
    times, offsets = np.array(seen["offsets"]).T
    assert len(times) > 1000
    # A machine that is too busy leaves frames out, and what is cut off at once may be seen and not heard.
    assert (np.abs(offsets) <= FRAME + 0.005).mean() >= 0.995 - session["dropped"] / len(times)
    first, last = offsets[times < 60], offsets[times > 60 * (MINUTES - 1)]
    assert len(first) > 10
    assert len(last) > 10
    assert abs(np.median(last) - np.median(first)) <= FRAME
    assert seen["pictures"] > 0.8 * 60 * MINUTES * 25  # a busy machine leaves out more


def test_memory_and_threads_do_not_grow(session: dict[str, Any]) -> None:
    memory = np.array(session["memory"])
    assert len(memory) > MINUTES
    # In the beginning what is kept fills up: fifty utterances, a hundred timings, the allocator's arenas.
    settled, end = memory[len(memory) // 6 : len(memory) // 3].mean(), memory[-len(memory) // 6 :].mean()
    assert end - settled < 4, memory.tolist()
    assert session["threads"] == ["MainThread"]
