from __future__ import annotations

import gzip
import json
import threading
import time
from collections.abc import Iterator
from email.utils import formatdate

import pytest
from odd_server import (
    DRIPPING_BODY,
    DRIPPING_HEADERS,
    OddServer,
    breaks_off,
    closed_port,
    floods,
    odd_server,
    resets,
    says_and_hangs_up,
    sends,
    streams,
    waits,
)

from app import exchange as module
from app.answer import Answer
from app.exchange import Exchange, ExchangeFailed

GOOD = sends(b"good", "text/plain")


@pytest.fixture
def server() -> Iterator[OddServer]:
    with odd_server(GOOD) as server:
        yield server


@pytest.fixture
def exchange(monkeypatch: pytest.MonkeyPatch) -> Iterator[Exchange]:
    monkeypatch.setattr(module, "BACKOFF", 0.01)
    exchange = Exchange(seconds=20, connect_seconds=5, retries=2, most_bytes=2_000_000, secrets=["s3cret"])
    yield exchange
    exchange.close()


@pytest.fixture
def hasty() -> Iterator[Exchange]:
    exchange = Exchange(seconds=0.4, connect_seconds=5, retries=2, most_bytes=2_000_000)
    yield exchange
    exchange.close()


def test_asks_and_is_answered(server: OddServer, exchange: Exchange) -> None:
    answer = exchange.ask(
        "POST", f"{server.url}/say?a=1", params={"b": "ö &"}, headers={"X-Own": "yes"}, content=b"hello"
    )
    assert answer == Answer(b"good", "text/plain")
    (asked,) = server.asked
    assert (asked.method, asked.path, asked.body) == ("POST", "/say?a=1&b=%C3%B6+%26", b"hello")
    assert asked.headers["x-own"] == "yes"


def test_chunks_are_joined(server: OddServer, exchange: Exchange) -> None:
    server.then(streams([b"one ", b"two ", b"three"]))
    assert exchange.ask("GET", server.url).body == b"one two three"


def test_from_many_threads_over_kept_connections(server: OddServer, exchange: Exchange) -> None:
    answers: list[bytes] = []
    threads = [
        threading.Thread(target=lambda: answers.extend(exchange.ask("GET", server.url).body for _ in range(5)))
        for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answers == [b"good"] * 40


@pytest.mark.parametrize("behaviour", [waits, DRIPPING_BODY, DRIPPING_HEADERS], ids=["silent", "body", "headers"])
def test_one_limit_for_everything(server: OddServer, hasty: Exchange, behaviour) -> None:
    server.then(behaviour)
    with pytest.raises(ExchangeFailed, match=r"no whole answer within 0\.4 s"):
        hasty.ask("POST", server.url, seconds=0.4)
    server.then(GOOD)
    assert hasty.ask("POST", server.url, seconds=20).body == b"good"


@pytest.mark.parametrize("status", [408, 429, 500, 503])
def test_tries_again(server: OddServer, exchange: Exchange, status: int) -> None:
    server.then(sends(b"busy", "text/plain", status), resets, GOOD)
    assert exchange.ask("POST", server.url, content=b"again").body == b"good"
    assert [asked.body for asked in server.asked] == [b"again"] * 3


def test_tries_so_often_and_no_more(server: OddServer, exchange: Exchange) -> None:
    server.then(sends(json.dumps({"error": {"message": "model\nis loading"}}).encode(), "application/json", 503))
    with pytest.raises(ExchangeFailed, match="answered 503 Service Unavailable: “model is loading”"):
        exchange.ask("POST", server.url)
    assert len(server.asked) == 3


@pytest.mark.parametrize("status", [400, 401, 404, 422])
def test_does_not_try_what_cannot_help(server: OddServer, exchange: Exchange, status: int) -> None:
    server.then(sends(b'{"detail": [{"msg": "no s3cret voice"}]}', "application/json", status))
    with pytest.raises(ExchangeFailed, match=f"answered {status} .*“no … voice”"):
        exchange.ask("POST", server.url)
    assert len(server.asked) == 1


def test_waits_as_long_as_it_is_asked_to(server: OddServer, exchange: Exchange) -> None:
    server.then(sends(b"", status=429, Retry_After="1"), GOOD)
    before = time.monotonic()
    assert exchange.ask("POST", server.url).body == b"good"
    assert time.monotonic() - before >= 1.0


@pytest.mark.parametrize("as_date", [False, True])
def test_does_not_wait_beyond_its_limit(server: OddServer, exchange: Exchange, as_date: bool) -> None:
    after = formatdate(time.time() + 3600, usegmt=True) if as_date else "3600"
    server.then(sends(b"", status=429, Retry_After=after), GOOD)
    with pytest.raises(ExchangeFailed, match=r"429 Too Many Requests; it asks to come back in 3[56]\d\d s"):
        exchange.ask("POST", server.url)
    assert len(server.asked) == 1


def test_nobody_there(exchange: Exchange) -> None:
    port = closed_port()
    with pytest.raises(ExchangeFailed, match=rf"127\.0\.0\.1:{port} cannot be connected to") as caught:
        exchange.ask("GET", f"http://127.0.0.1:{port}")
    assert "running" in caught.value.advice


def test_an_unknown_name(exchange: Exchange) -> None:
    with pytest.raises(ExchangeFailed, match=r"nobody\.invalid cannot be connected to"):
        exchange.ask("GET", "http://nobody.invalid/")


def test_reset_every_time(server: OddServer, exchange: Exchange) -> None:
    server.then(resets)
    with pytest.raises(ExchangeFailed, match="gave no answer"):
        exchange.ask("GET", server.url)
    assert len(server.asked) == 3


def test_broken_off(server: OddServer, exchange: Exchange) -> None:
    server.then(breaks_off(b"half", 8))
    with pytest.raises(ExchangeFailed, match="broke its answer off"):
        exchange.ask("GET", server.url)
    assert len(server.asked) == 1


def test_redirects_are_refused(server: OddServer, exchange: Exchange) -> None:
    server.then(sends(b"", status=307, Location="/v2/speak?text=private"))
    with pytest.raises(ExchangeFailed, match=f"redirects to {server.url}/v2/speak$"):
        exchange.ask("POST", server.url)
    assert len(server.asked) == 1


@pytest.mark.parametrize(
    "behaviour",
    [
        floods,
        breaks_off(b"", 99_999_999_999),
        sends(gzip.compress(bytes(50_000_000)), Content_Encoding="gzip"),
    ],
    ids=["endless", "told", "packed"],
)
def test_too_much(server: OddServer, exchange: Exchange, behaviour) -> None:
    server.then(behaviour)
    with pytest.raises(ExchangeFailed, match="sent more than 2,000,000 bytes"):
        exchange.ask("GET", server.url)


def test_packed_wrongly(server: OddServer, exchange: Exchange) -> None:
    server.then(sends(b"no gzip", Content_Encoding="gzip"))
    with pytest.raises(ExchangeFailed, match="cannot be unpacked"):
        exchange.ask("GET", server.url)


def test_no_http_at_all(server: OddServer, exchange: Exchange) -> None:
    server.then(says_and_hangs_up(b"SSH-2.0-OpenSSH_9.2\r\n"))
    with pytest.raises(ExchangeFailed, match="gave no answer"):
        exchange.ask("GET", server.url)


def test_closing_ends_what_waits_and_the_next_connects_anew(server: OddServer, exchange: Exchange) -> None:
    server.then(waits)
    failures: list[ExchangeFailed] = []

    def ask() -> None:
        try:
            exchange.ask("GET", server.url)
        except ExchangeFailed as error:
            failures.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    while not server.asked:
        time.sleep(0.01)
    exchange.close()
    thread.join(10)
    assert [failure.reason for failure in failures] == ["it was closed"]
    exchange.close()
    server.then(GOOD)
    assert exchange.ask("GET", server.url).body == b"good"


def test_no_thread_stays_when_it_is_forgotten(server: OddServer) -> None:
    def threads() -> set[threading.Thread]:
        return {thread for thread in threading.enumerate() if thread.name == "exchange"}

    before = threads()
    forgotten = Exchange(seconds=20, most_bytes=100)
    forgotten.ask("GET", server.url)
    (own,) = threads() - before
    del forgotten
    own.join(10)
    assert not own.is_alive()
