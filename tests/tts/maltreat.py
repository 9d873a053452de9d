"""What every engine with a process of its own must survive."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import pytest

from app.errors import SpeechFailed
from app.speech import Speech
from app.tts.engine import SpeechEngine


class InAProcess(SpeechEngine, Protocol):
    """An engine that tells the number of its process."""

    @property
    def process(self) -> int | None: ...


def survives_a_kill(engine: InAProcess) -> Speech:
    """Killed while it waits: the next sentence works. Killed at work: that one fails, the next works."""
    engine.warm_up()
    engine.speak("Hello.")
    first = engine.process
    assert first is not None
    os.kill(first, signal.SIGKILL)
    os.waitid(os.P_PID, first, os.WEXITED | os.WNOWAIT)
    engine.speak("Hello again.")
    second = engine.process
    assert second not in (None, first)
    assert second is not None
    os.kill(second, signal.SIGSTOP)  # it will not have answered when it is killed
    killer = threading.Timer(0.2, os.kill, (second, signal.SIGKILL))
    killer.start()
    with pytest.raises(SpeechFailed, match=rf"speech engine {engine.name}: .*signal 9"):
        engine.speak("This fails.")
    killer.join()
    return engine.speak("This works.")


def survives_a_hang(engine: InAProcess, limit: Callable[[float], None]) -> Speech:
    """It does not answer within its limit: the sentence fails, the process is ended, the next sentence works.

    `limit` sets the seconds that it may take.
    """
    engine.warm_up()
    engine.speak("Hello.")
    stuck = engine.process
    assert stuck is not None
    os.kill(stuck, signal.SIGSTOP)
    limit(0.3)
    with pytest.raises(SpeechFailed, match=rf"speech engine {engine.name}: .*longer than 0.3 s"):
        engine.speak("This takes for ever.")
    assert engine.process is None
    limit(30.0)
    return engine.speak("This works.")


def without_espeak(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide the extra from processes that start from now on; skips if the system has the library, too."""
    import ctypes

    if sys.platform != "linux":
        pytest.skip("other systems have other voices")
    try:
        ctypes.CDLL("libespeak-ng.so.1")
    except OSError:
        (folder / "espeakng_loader.py").write_text("raise ImportError('hidden')\n")
        monkeypatch.setenv("PYTHONPATH", str(folder))
        return
    pytest.skip("the system's espeak-ng is installed")
