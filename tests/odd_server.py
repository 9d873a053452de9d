"""A real HTTP server on this machine that answers well or badly, as each test tells it."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass(frozen=True)
class Asked:
    """One request as it arrived."""

    method: str
    path: str
    headers: dict[str, str]
    body: bytes


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    server: OddHttpServer

    def do_POST(self) -> None:
        odd = self.server.odd
        body = self.rfile.read(int(self.headers.get("content-length", 0)))
        headers = {name.lower(): value for name, value in self.headers.items()}
        with odd.lock:
            odd.asked.append(Asked(self.command, self.path, headers, body))
            behaviour = odd.behaviours.pop(0) if len(odd.behaviours) > 1 else odd.behaviours[0]
        behaviour(self, odd)

    do_GET = do_POST  # noqa: N815 (http.server looks for it)

    def log_message(self, *_: Any) -> None:
        pass

    def handle(self) -> None:
        try:
            super().handle()
        except OSError:  # the client has gone, as it should
            self.close_connection = True

    def finish(self) -> None:
        with suppress(OSError):
            super().finish()


Behaviour = Callable[[Handler, "OddServer"], None]


class OddHttpServer(ThreadingHTTPServer):
    daemon_threads = True
    odd: OddServer


@dataclass
class OddServer:
    """Answers the first request as the first behaviour says, and so on; the last one stays."""

    url: str
    behaviours: list[Behaviour]
    asked: list[Asked] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)
    over: threading.Event = field(default_factory=threading.Event)

    def then(self, *behaviours: Behaviour) -> None:
        self.behaviours[:] = behaviours


@contextmanager
def odd_server(*behaviours: Behaviour) -> Iterator[OddServer]:
    server = OddHttpServer(("127.0.0.1", 0), Handler)
    odd = server.odd = OddServer(f"http://127.0.0.1:{server.server_port}", list(behaviours))
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield odd
    finally:
        odd.over.set()
        server.shutdown()
        server.server_close()


# --- behaviours -------------------------------------------------------------------------------------------------------


def sends(body: bytes, kind: str = "audio/wav", status: int = 200, **headers: str) -> Behaviour:
    def behave(handler: Handler, _: OddServer) -> None:
        handler.send_response(status)
        handler.send_header("Content-Type", kind)
        handler.send_header("Content-Length", str(len(body)))
        for name, value in headers.items():
            handler.send_header(name.replace("_", "-"), value)
        handler.end_headers()
        handler.wfile.write(body)

    return behave


def streams(parts: Sequence[bytes], kind: str = "audio/wav") -> Behaviour:
    """In chunks, as one who does not know the length yet."""

    def behave(handler: Handler, _: OddServer) -> None:
        handler.send_response(200)
        handler.send_header("Content-Type", kind)
        handler.send_header("Transfer-Encoding", "chunked")
        handler.end_headers()
        for part in (*parts, b""):
            handler.wfile.write(f"{len(part):x}\r\n".encode() + part + b"\r\n")

    return behave


def waits(handler: Handler, odd: OddServer) -> None:
    """Never answers."""
    odd.over.wait(60)
    handler.close_connection = True


def drips(beginning: bytes) -> Behaviour:
    """Sends `beginning` (from the status line on), then a byte every 50 ms for ever."""

    def behave(handler: Handler, odd: OddServer) -> None:
        handler.wfile.write(beginning)
        while not odd.over.wait(0.05):
            handler.wfile.write(b"x")

    return behave


DRIPPING_BODY = drips(b"HTTP/1.1 200 OK\r\nContent-Type: audio/wav\r\nContent-Length: 100000\r\n\r\n")
DRIPPING_HEADERS = drips(b"HTTP/1.1 200 OK\r\nX-Long: ")


def floods(handler: Handler, odd: OddServer) -> None:
    """Sends for ever."""
    handler.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Type: audio/wav\r\n\r\n")
    while not odd.over.is_set():
        handler.wfile.write(bytes(1_000_000))


def resets(handler: Handler, _: OddServer) -> None:
    """Resets the connection instead of answering."""
    handler.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    handler.connection.close()
    handler.close_connection = True


def says_and_hangs_up(beginning: bytes) -> Behaviour:
    """Sends `beginning`, from the status line on, and ends the connection in good order."""

    def behave(handler: Handler, _: OddServer) -> None:
        handler.wfile.write(beginning)
        handler.close_connection = True

    return behave


def breaks_off(body: bytes, promised: int) -> Behaviour:
    """Promises more bytes than it sends."""

    def behave(handler: Handler, _: OddServer) -> None:
        handler.send_response(200)
        handler.send_header("Content-Type", "audio/wav")
        handler.send_header("Content-Length", str(promised))
        handler.end_headers()
        handler.wfile.write(body)
        handler.wfile.flush()
        handler.connection.shutdown(socket.SHUT_RDWR)
        handler.close_connection = True

    return behave


def closed_port() -> int:
    """A port of this machine on which nobody listens."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
