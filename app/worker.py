"""A process of its own for a library that may hang, crash or hold Python's global lock.

This end (`Worker`) starts it with the first question, kills it when an answer takes too long, and starts another one
after it died. The other end is a module that calls `serve`. They talk through the process's standard input and output:
a 4-byte length, JSON, and as many bytes as its ``bytes`` says; answers likewise.
"""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

_HEADER = struct.Struct(">I")


class WorkerFailed(Exception):
    """The process died, took too long or answered with an error; the message says which."""


class Worker:
    """Starts, asks and replaces the process. May be used from several threads: one question at a time, others wait.

    Args:
        module: run as the process's program, e.g. ``app.tts.espeak_worker``; it must call `serve`.
    """

    def __init__(self, module: str) -> None:
        self._module = module
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._process: _Process | None = None

    @property
    def pid(self) -> int | None:
        """Number of the process that is at work or waiting for it; None if there is none."""
        process = self._process
        return process.pid if process is not None and process.alive else None

    def ask(self, question: Mapping[str, Any], payload: bytes = b"", *, seconds: float) -> tuple[Any, bytes]:
        """The process's answer and the bytes that came with it.

        Args:
            question: for JSON.
            payload: bytes that go with it.
            seconds: after which the process is killed, the time for starting it included; waiting for others is not.

        Raises:
            WorkerFailed: it died, took too long or could not answer. The next question starts another process, unless
                it is the same that could not answer.
        """
        with self._lock:
            if self._process is not None and not self._process.alive:
                self._drop()
            try:
                if self._process is None:
                    self._process = _Process(self._module)
                if self._closing.is_set():  # looked at after the start: a new process cannot escape `close`
                    raise WorkerFailed("it was closed")
                reply, data = self._process.ask(question, payload, seconds)
            except BaseException:  # Ctrl-C, too: the answer must not be taken for that to the next question
                self._drop()
                raise
        if "error" in reply:
            raise WorkerFailed(str(reply["error"]))
        return reply["answer"], data

    def close(self) -> None:
        """End the process; a question under way in another thread fails at once, the next one starts another."""
        self._closing.set()
        if (process := self._process) is not None:
            process.kill()
        with self._lock:
            self._drop()
            self._closing.clear()

    def _drop(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.end()


class _Process:
    """One process and the pipes to it."""

    def __init__(self, module: str) -> None:
        found = [str(Path(__file__).resolve().parents[1]), os.environ.get("PYTHONPATH", "")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, found))}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", module],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._in: BinaryIO = self._process.stdin  # type: ignore[assignment]
        self._out: BinaryIO = self._process.stdout  # type: ignore[assignment]
        self._finalizer = weakref.finalize(self, _end, self._process)

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        return self._process.pid

    def ask(self, question: Mapping[str, Any], payload: bytes, seconds: float) -> tuple[dict[str, Any], bytes]:
        expired = threading.Event()

        def expire() -> None:
            expired.set()
            self._process.kill()

        timer = threading.Timer(seconds, expire)
        timer.daemon = True
        timer.start()
        try:
            write(self._in, question, payload)
            reply = read(self._out)
            if reply is None:
                raise EOFError
            return reply
        except (OSError, EOFError, ValueError) as error:
            if expired.is_set():
                raise WorkerFailed(f"it took longer than {seconds:g} s and was ended") from error
            raise WorkerFailed(f"its process ended ({_reason(self._process)})") from error
        finally:
            timer.cancel()

    def kill(self) -> None:
        """Make whoever waits for an answer wait no longer; the rest is for `end` to do."""
        self._process.kill()

    def end(self) -> None:
        self._finalizer()


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):  # what was not sent cannot be sent any more
                pipe.close()


def _reason(process: subprocess.Popen[bytes]) -> str:
    try:
        code = process.wait(5)
    except subprocess.TimeoutExpired:
        return "its pipes broke"
    return f"signal {-code}" if code < 0 else f"exit code {code}"


# --- the other end ----------------------------------------------------------------------------------------------------


def serve(answer: Callable[[dict[str, Any], bytes], tuple[Any, bytes]]) -> None:
    """Answer the questions on standard input until it ends.

    Args:
        answer: from a question and its bytes to what JSON can carry and bytes. What it raises is the answer's error.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the other end's to handle
    source, sink = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints must not get between the answers
    while (asked := read(source)) is not None:
        try:
            reply, data = answer(*asked)
        except Exception as error:
            write(sink, {"error": f"{type(error).__name__}: {error}"})
        else:
            write(sink, {"answer": reply}, data)


def read(source: BinaryIO) -> tuple[dict[str, Any], bytes] | None:
    """One message with its bytes; None at the end of the input."""
    header = source.read(_HEADER.size)
    if len(header) < _HEADER.size:
        return None
    (size,) = _HEADER.unpack(header)
    body = source.read(size)
    if len(body) < size:
        return None
    message = dict(json.loads(body))
    count = message.pop("bytes", 0)
    payload = source.read(count)
    return (message, payload) if len(payload) == count else None


def write(sink: BinaryIO, message: Mapping[str, Any], payload: bytes = b"") -> None:
    """Send one message with its bytes."""
    body = json.dumps({**message, "bytes": len(payload)}).encode()
    sink.write(_HEADER.pack(len(body)) + body + payload)
    sink.flush()
