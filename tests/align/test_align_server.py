from __future__ import annotations

import http.client
import io
import socket
import threading
import wave
import xmlrpc.client
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from app.align import align_server as module
from app.align.align_server import AlignServer
from app.align.aligner import Alignment
from app.align.dictionary import NO_LEXICON, Lexicon
from app.align.mock import MockAligner
from app.errors import InputError

RATE = 16_000


class SlowAligner(MockAligner):
    """Waits until it is let go; "boom" breaks it."""

    def __init__(self) -> None:
        super().__init__()
        self.begun = threading.Semaphore(0)
        self.go = threading.Event()
        self.closed = False

    def align(self, samples: NDArray[np.float32], rate: int, text: str, *, lexicon: Lexicon = NO_LEXICON) -> Alignment:
        self.begun.release()
        if text == "boom":
            raise RuntimeError("boom")
        if text == "wait":
            self.go.wait(30)
        return super().align(samples, rate, text, lexicon=lexicon)

    def close(self) -> None:
        self.closed = True


@contextmanager
def serving(aligner: MockAligner, workers: int = 1) -> Iterator[AlignServer]:
    server = AlignServer(lambda: aligner, host="127.0.0.1", port=0, workers=workers)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.end()
        thread.join(10)
        assert not thread.is_alive()


@pytest.fixture(scope="module")
def server() -> Iterator[AlignServer]:
    with serving(MockAligner()) as server:
        yield server


@pytest.fixture
def proxy(server: AlignServer) -> Iterator[Any]:
    with proxy_of(server) as proxy:
        yield proxy


def proxy_of(server: AlignServer) -> Any:
    """The library's own client."""
    return xmlrpc.client.ServerProxy(f"http://127.0.0.1:{server.server_port}/RPC2", use_builtin_types=True)


def wav(seconds: float = 1.0) -> bytes:
    file = io.BytesIO()
    with wave.open(file, "wb") as writer:
        writer.setnchannels(1)
        writer.setsampwidth(2)
        writer.setframerate(RATE)
        writer.writeframes((8_000 * np.sin(np.arange(round(seconds * RATE)) * 0.1)).astype("<i2").tobytes())
    return file.getvalue()


def asked(server: AlignServer, method: str, path: str, body: bytes = b"", **headers: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    try:
        connection.request(method, path, body, headers)
        response = connection.getresponse()
        return response.status, response.read().decode()
    finally:
        connection.close()


def test_the_librarys_own_client_is_answered(proxy: Any) -> None:
    found = proxy.align(wav(), "Hello there.")
    assert [word[0] for word in found["words"]] == ["Hello", "there."]
    assert [phone[0] for phone in found["phones"] if phone[0] != "SIL"] == ["HH", "AH", "L", "OW", "DH", "EH", "R"]
    assert found["phones"][-1][2] == 1.0
    assert (found["guessed"], found["confidence"], found["aligner"]) == ([], 1.0, "mock")
    assert proxy.system.listMethods() == ["align", "system.listMethods"]


def test_a_lexicon(proxy: Any) -> None:
    for said in (["B", "IY"], "B IY1"):
        phones = proxy.align(wav(), "Qwyx", {"qwyx": said})["phones"]
        assert [phone[0] for phone in phones if phone[0] != "SIL"] == ["B", "IY"]


@pytest.mark.parametrize(
    ("parameters", "code", "said"),
    [
        ((), -32602, "align takes a WAV"),
        (("text",), -32602, "align takes a WAV"),
        ((wav(), 1), -32602, "align takes a WAV"),
        ((wav(), "hi", "HH AY"), -32602, "align takes a WAV"),
        ((b"no wav", "hi"), 2, "cannot be read as sound"),
        ((wav(0), "hi"), 2, "sound"),
        ((wav(), "hi", {"hi": ["QQ"]}), 2, "QQ"),
        ((wav(), "hi", {"hi": [1]}), 2, "lexicon"),
        ((wav(), "hi", {"hi": 1}), 2, "lexicon"),
        ((wav(), " "), 1, "no words"),
    ],
)
def test_faults(proxy: Any, parameters: tuple[Any, ...], code: int, said: str) -> None:
    with pytest.raises(xmlrpc.client.Fault, match=said) as caught:
        proxy.align(*parameters)
    assert caught.value.faultCode == code
    assert proxy.align(wav(), "hi")["words"]


def test_no_such_method(proxy: Any) -> None:
    with pytest.raises(xmlrpc.client.Fault, match="no method 'recognise'") as caught:
        proxy.recognise(wav())
    assert caught.value.faultCode == -32601


def test_what_is_no_call(server: AlignServer) -> None:
    bomb = b'<!DOCTYPE x [<!ENTITY a "ha">]><methodCall><methodName>&a;</methodName></methodCall>'
    for body in (b"", b"hi", bomb):
        status, answer = asked(server, "POST", "/RPC2", body)
        assert status == 200
        assert "-32700" in answer


def test_what_is_no_request(server: AlignServer, monkeypatch: pytest.MonkeyPatch) -> None:
    assert asked(server, "GET", "/RPC2")[0] == 405
    assert asked(server, "POST", "/elsewhere")[0] == 404
    assert asked(server, "PUT", "/RPC2")[0] == 501
    with socket.create_connection(("127.0.0.1", server.server_port), 30) as connection:
        connection.sendall(b"POST /RPC2 HTTP/1.0\r\n\r\n")
        assert b" 411 " in connection.recv(100)
    monkeypatch.setattr(module, "MOST_BYTES", 10)
    assert asked(server, "POST", "/RPC2", b"x" * 11) == (413, "More than 10 bytes.")


def test_who_sends_slowly_is_sent_away(server: AlignServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "READ_SECONDS", 0.5)
    with socket.create_connection(("127.0.0.1", server.server_port), 30) as connection:
        connection.sendall(b"POST /RPC2 HTTP/1.0\r\nContent-Length: 1000\r\n\r\n")
        connection.settimeout(0.05)
        answer = None
        for _ in range(600):
            with suppress(TimeoutError, BrokenPipeError):
                connection.sendall(b"x")
                answer = connection.recv(100)
                break
        assert answer == b""


def test_a_broken_aligner_is_a_fault_and_the_next_request_works() -> None:
    with serving(SlowAligner()) as server, proxy_of(server) as proxy:
        with pytest.raises(xmlrpc.client.Fault, match="RuntimeError: boom") as caught:
            proxy.align(wav(), "boom")
        assert caught.value.faultCode == 3
        assert proxy.align(wav(), "hi")["words"]


def test_busy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "WAIT_SECONDS", 0.05)
    aligner = SlowAligner()
    with serving(aligner) as server:
        waiting: list[Any] = []
        thread = threading.Thread(target=lambda: waiting.append(proxy_of(server).align(wav(), "wait")))
        thread.start()
        assert aligner.begun.acquire(timeout=30)
        with pytest.raises(xmlrpc.client.ProtocolError) as caught, proxy_of(server) as proxy:
            proxy.align(wav(), "hi")
        assert (caught.value.errcode, caught.value.headers["Retry-After"]) == (503, "1")
        aligner.go.set()
        thread.join(30)
        assert waiting[0]["words"]
    assert aligner.closed


def test_too_many_connections() -> None:
    with serving(MockAligner()) as server:
        held = [socket.create_connection(("127.0.0.1", server.server_port)) for _ in range(module.CONNECTIONS)]
        with socket.create_connection(("127.0.0.1", server.server_port), 30) as one_more:
            assert b" 503 " in one_more.recv(100)
        for connection in held:
            connection.close()
        status = 503
        while status == 503:  # until they have been noticed
            status, _ = asked(server, "GET", "/")
        assert status == 405


def test_it_ends_while_one_waits() -> None:
    aligner = SlowAligner()
    with serving(aligner) as server:
        thread = threading.Thread(target=lambda: asked(server, "POST", "/RPC2", request("wait")))
        thread.start()
        assert aligner.begun.acquire(timeout=30)
    aligner.go.set()
    thread.join(30)
    assert not thread.is_alive()


def request(text: str) -> bytes:
    return xmlrpc.client.dumps((xmlrpc.client.Binary(wav()), text), "align").encode()


def test_a_port_in_use(server: AlignServer) -> None:
    with pytest.raises(InputError, match=f"port {server.server_port} cannot be listened on"):
        AlignServer(MockAligner, host="127.0.0.1", port=server.server_port)
