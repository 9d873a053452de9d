from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import logging, structlog
from app.api import logs
logs.configure()
structlog.get_logger("mary.x").info("hello", number=5)
logging.getLogger("app.y").warning("plain %s", "words")
logging.getLogger("aiortc.z").info("too much")
logging.getLogger("uvicorn.error").error("ASGI callable returned without completing response.")
"""


def test_both_kinds_of_logs_look_alike() -> None:
    # in a process of its own: the configuration is the process's
    lines = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True
    ).stderr.splitlines()
    assert len(lines) == 2
    assert "hello" in lines[0]
    assert "number=5" in lines[0]
    assert "mary.x" in lines[0]
    assert "plain words" in lines[1]
    assert "warning" in lines[1]
    assert "\x1b" not in "".join(lines), "colours are for terminals"


def test_a_traceback_holds_nothing_of_what_was_said() -> None:
    script = """
import structlog
from app.api import logs
logs.configure()
def fail(said):
    raise RuntimeError("broken")
try:
    fail("a " + "secret")
except RuntimeError:
    structlog.get_logger("mary.x").exception("failed")
"""
    told = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stderr
    assert "RuntimeError: broken" in told
    assert "a secret" not in told
