"""Serves an aligner by XML-RPC, so that it can run on another machine than the service that asks it.

Requests are bounded in size, time and number. There is no password: who can reach the port can use it.
"""

from __future__ import annotations

import io
import logging
import queue
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, HTTPServer
from socketserver import ThreadingMixIn
from typing import Any

from app.align.aligner import Aligner
from app.align.alignment_message import (
    BAD_PARAMETERS,
    METHOD,
    MOST_BYTES,
    NO_METHOD,
    NOT_XML,
    BadMessage,
    answer,
    fault,
    fault_of,
    listed,
    read_call,
)
from app.align.dictionary import NO_LEXICON, Lexicon, read_lexicon
from app.align.sound_file import read_sound
from app.errors import InputError

PORT = 8765
PATH = "/RPC2"
CONNECTIONS = 32  # at once; who comes then is told to come again
READ_SECONDS = 30.0  # in which a request must have arrived
WAIT_SECONDS = 10.0  # for an aligner to be free
LONGEST = 1_000.0  # seconds of sound

_log = logging.getLogger(__name__)


class AlignServer(ThreadingMixIn, HTTPServer):
    """Listens once it is made; `serve_forever` answers, in a thread for each request.

    Args:
        make_aligner: a new aligner; called `workers` times, before anything is listened to.
        host: address to listen on.
        port: 0 takes a free one; `server_port` is the one taken.
        workers: aligners at work at once.

    Raises:
        MaryError: from `make_aligner`.
        InputError: the address cannot be listened on.
    """

    daemon_threads = True
    block_on_close = False
    request_queue_size = CONNECTIONS

    def __init__(self, make_aligner: Callable[[], Aligner], *, host: str, port: int, workers: int = 1) -> None:
        self._aligners = [make_aligner() for _ in range(workers)]
        self._free: queue.SimpleQueue[Aligner] = queue.SimpleQueue()
        self._places = threading.BoundedSemaphore(CONNECTIONS)
        for aligner in self._aligners:
            self._free.put(aligner)
        if ":" in host:
            self.address_family = socket.AF_INET6
        try:
            super().__init__((host, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            raise InputError(f"{host} port {port} cannot be listened on: {reason}", field="port") from error

    def warm_up(self) -> None:
        """Load what aligning needs, so that the first request does not wait for it."""
        for aligner in self._aligners:
            if callable(warm_up := getattr(aligner, "warm_up", None)):
                warm_up()

    def end(self) -> None:
        """Stop listening; alignments under way fail, their processes end. `serve_forever` must be running."""
        self.shutdown()
        self.server_close()
        for aligner in self._aligners:
            if callable(close := getattr(aligner, "close", None)):
                close()

    def server_bind(self) -> None:
        """As `HTTPServer`, without its question for this machine's name, which can take seconds."""
        super(HTTPServer, self).server_bind()
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def answer(self, request: bytes) -> bytes:
        """The response to a request.

        Raises:
            queue.Empty: no aligner was free in time.
        """
        try:
            method, parameters = read_call(request)
        except BadMessage as error:
            return fault(NOT_XML, str(error))
        if method == "system.listMethods":
            return listed([METHOD, method])
        if method != METHOD:
            return fault(NO_METHOD, f"there is no method {method[:80]!r}, only {METHOD!r}")
        match parameters:
            case [bytes() as wav, str() as text]:
                lexicon: Any = {}
            case [bytes() as wav, str() as text, dict() as lexicon]:
                pass
            case _:
                return fault(BAD_PARAMETERS, "align takes a WAV file (base64), a text (string), a lexicon (struct)")
        try:
            return self._aligned(wav, text, _lexicon(lexicon))
        except queue.Empty:
            raise
        except Exception as error:  # whatever another package's aligner raises: the next request is answered
            return fault_of(error)

    def _aligned(self, wav: bytes, text: str, lexicon: Lexicon) -> bytes:
        samples, rate = read_sound(io.BytesIO(wav), longest=LONGEST, name="the sound")
        aligner = self._free.get(timeout=WAIT_SECONDS)
        begun = time.perf_counter()
        try:
            found = aligner.align(samples, rate, text, lexicon=lexicon)
        finally:
            self._free.put(aligner)
        _log.info("aligned %.1f s of sound in %.2f s", len(samples) / rate, time.perf_counter() - begun)
        return answer(found, aligner.name)

    # --- connections

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._places.acquire(blocking=False):
            try:
                super().process_request(request, client_address)
            except BaseException:  # no thread could be started
                self._places.release()
                raise
            return
        with suppress(OSError):
            request.sendall(b"HTTP/1.0 503 Service Unavailable\r\nRetry-After: 1\r\nContent-Length: 0\r\n\r\n")
        self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._places.release()

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002
        _log.warning("a request could not be answered", exc_info=True)


def _lexicon(given: dict[str, Any]) -> Lexicon:
    if not given:
        return NO_LEXICON
    for said in given.values():
        if isinstance(said, str) or (isinstance(said, list) and all(isinstance(phone, str) for phone in said)):
            continue
        raise InputError("lexicon: a word is pronounced with a string or an array of phones", field="lexicon")
    return read_lexicon(given)


class _Handler(BaseHTTPRequestHandler):
    """One request; the connection ends with it."""

    server: AlignServer
    server_version = "mary"
    sys_version = ""
    timeout = READ_SECONDS

    def setup(self) -> None:
        super().setup()
        self._limit = threading.Timer(READ_SECONDS, self._expire)  # `timeout` limits every single wait only
        self._limit.daemon = True
        self._limit.start()

    def finish(self) -> None:
        self._limit.cancel()
        with suppress(OSError):
            super().finish()

    def handle(self) -> None:
        with suppress(OSError):  # whoever asked has gone
            super().handle()

    def do_POST(self) -> None:
        if self.path not in (PATH, "/"):
            return self._refuse(HTTPStatus.NOT_FOUND, f"XML-RPC is at {PATH}.")
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal():
            return self._refuse(HTTPStatus.LENGTH_REQUIRED, "Content-Length is missing.")
        if int(length) > MOST_BYTES:
            return self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"More than {MOST_BYTES:,} bytes.")
        body = self.rfile.read(int(length))
        self._limit.cancel()
        if len(body) < int(length):
            return None
        try:
            return self._send(HTTPStatus.OK, "text/xml", self.server.answer(body))
        except queue.Empty:
            return self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, "All aligners are busy.", {"Retry-After": "1"})

    def do_GET(self) -> None:
        self._refuse(HTTPStatus.METHOD_NOT_ALLOWED, f"An aligner: XML-RPC by POST to {PATH}.", {"Allow": "POST"})

    def log_message(self, format: str, *values: Any) -> None:
        _log.debug(format, *values)

    def _expire(self) -> None:
        with suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)

    def _refuse(self, status: HTTPStatus, why: str, headers: dict[str, str] | None = None) -> None:
        self._send(status, "text/plain; charset=utf-8", why.encode(), headers or {})

    def _send(self, status: HTTPStatus, kind: str, body: bytes, headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": kind, "Content-Length": str(len(body)), **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)
