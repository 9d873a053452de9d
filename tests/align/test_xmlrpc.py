from __future__ import annotations

import re
import threading
import time
import xmlrpc.server
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from odd_server import OddServer, closed_port, odd_server, resets, sends, waits
from test_align_server import SlowAligner, serving

from app import exchange
from app.align.aligner import Aligner, Alignment
from app.align.alignment_message import answer, fault
from app.align.pocketsphinx import PocketSphinxAligner
from app.align.registry import create
from app.align.xmlrpc import XmlRpcAligner
from app.errors import AlignmentFailed, ConfigError, InputError, NothingToSay
from app.speech import Phone, Speech, Word

RATE = 16_000
SOUND = (0.3 * np.sin(np.arange(RATE) * 0.1)).astype(np.float32)
FOUND = Alignment((Phone("HH", 0.0, 0.25), Phone("AY", 0.25, 1.0)), (Word("Hi.", 0.0, 1.0),), (), 0.75)
GOOD = sends(answer(FOUND, "mock"), "text/xml")


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[OddServer]:
    monkeypatch.setattr(exchange, "BACKOFF", 0.01)
    with odd_server(GOOD) as server:
        yield server


@pytest.fixture
def make() -> Iterator[type[XmlRpcAligner]]:
    made: list[XmlRpcAligner] = []

    def new(**options: object) -> XmlRpcAligner:
        aligner = create("xmlrpc", options)
        assert isinstance(aligner, XmlRpcAligner)
        made.append(aligner)
        return aligner

    yield new  # type: ignore[misc]
    for aligner in made:
        aligner.close()


class Pocket(PocketSphinxAligner):
    """The one that all tests share, which no server may end."""

    def __init__(self, shared: PocketSphinxAligner) -> None:
        self.shared = shared

    def align(self, *arguments: Any, **options: Any) -> Alignment:
        return self.shared.align(*arguments, **options)

    def warm_up(self) -> None:
        self.shared.warm_up()

    def close(self) -> None:
        pass


def test_our_own_aligner_far_away_finds_what_it_finds_here(
    make, sphinx: PocketSphinxAligner, spoken: tuple[Speech, ...]
) -> None:
    with serving(Pocket(sphinx)) as server:
        far = make(url=f"http://127.0.0.1:{server.server_port}/RPC2", seconds=60)
        assert isinstance(far, Aligner)
        speech = spoken[0]
        text = "She sells sea shells by the sea shore."
        here = sphinx.align((np.round(speech.samples * 32767) / 32768).astype(np.float32), speech.rate, text)
        there = far.align(speech.samples, speech.rate, text)
        assert there == here
        with pytest.raises(NothingToSay):
            far.align(speech.samples, speech.rate, "…")
        with pytest.raises(AlignmentFailed, match=r"aligner xmlrpc: 127\.0\.0\.1:.*too short"):
            far.align(speech.samples[:800], speech.rate, text)
        changed = far.align(speech.samples, speech.rate, text, lexicon={"shells": ("SH", "EH", "L", "Z")})
        assert "EH" in [phone.symbol for phone in changed.phones]


def test_a_process_that_dies_there_is_told_here_and_the_next_call_works(
    make, sphinx: PocketSphinxAligner, spoken: tuple[Speech, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    speech, text = spoken[1], "My father bought five big boxes of fresh vegetables."
    with serving(Pocket(sphinx)) as server:
        far = make(url=f"http://127.0.0.1:{server.server_port}/RPC2", seconds=60)
        sphinx.warm_up()
        with monkeypatch.context() as patched:
            patched.setattr(sphinx, "time_limit", 1e-4)
            with pytest.raises(AlignmentFailed, match=r"aligner xmlrpc: .*aligner pocketsphinx: .*ended"):
                far.align(speech.samples, speech.rate, text)
        assert far.align(speech.samples, speech.rate, text).words[-1].text == "vegetables."


@contextmanager
def library_server(align: Callable[..., Any]) -> Iterator[str]:
    """As somebody else would write one, around a recogniser of their own."""
    server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
    server.register_function(align, "align")
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/RPC2"
    finally:
        server.shutdown()
        server.server_close()


def test_a_server_made_with_the_library(make) -> None:
    def align(wav: Any, text: str) -> dict[str, Any]:
        assert wav.data[:4] == b"RIFF"
        if "qwyx" in text:
            raise xmlrpc.server.Fault(7, "qwyx is not in the dictionary")
        return {"phones": [["hh", 0.0, 0.25], ["ay1", 0.25, 1.0]], "words": [["Hi.", 0.0, 1.0]], "confidence": 0.75}

    with library_server(align) as url:
        aligner = make(url=url, seconds=60, retries=0)
        assert aligner.align(SOUND, RATE, "Hi.") == FOUND
        with pytest.raises(AlignmentFailed, match=r"aligner xmlrpc: .*qwyx is not in the dictionary"):
            aligner.align(SOUND, RATE, "qwyx")
        aligner.close()  # it answers one connection at a time


def test_the_server_in_the_documentation_works(make) -> None:
    page = (Path(__file__).parents[2] / "docs/speech.md").read_text("utf-8")
    (example,) = re.findall(r"```text\n(def align.*?)```", page, re.DOTALL)
    made: dict[str, Any] = {}
    exec(example, made)
    with library_server(made["align"]) as url:
        aligner = make(url=url, seconds=60)
        found = aligner.align(SOUND, RATE, "Hi!", lexicon={"hi": ("HH", "AY")})
        assert [phone.symbol for phone in found.phones] == ["SIL", "HH", "AY", "SIL"]
        assert (found.words, found.guessed, found.confidence) == ((Word("Hi!", 0.1, 0.41),), (), 0.98)
        aligner.close()


@pytest.mark.parametrize(
    ("behaviour", "said"),
    [
        (waits, "no whole answer within 1.5 s"),
        (sends(b"", status=500), "answered 500"),
        (sends(b"hello", "text/plain"), "something else than an alignment"),
        (sends(b"<html></html>", "text/html"), "something else than an alignment"),
        (sends(b"", status=302, Location="/other"), "redirects"),
        (sends(fault(3, "no"), "text/xml"), "127.0.0.1:.*: no"),
        (resets, "gave no answer"),
    ],
)
def test_a_failure_names_the_aligner_and_the_next_call_works(server: OddServer, make, behaviour, said: str) -> None:
    aligner = make(url=server.url, seconds=1.5 if "1.5 s" in said else 20, retries=1)
    server.then(behaviour)
    with pytest.raises(AlignmentFailed, match=f"aligner xmlrpc: .*{said}") as caught:
        aligner.align(SOUND, RATE, "Hi.")
    assert caught.value.advice
    server.then(sends(b"", status=503), GOOD)
    assert aligner.align(SOUND, RATE, "Hi.") == FOUND


def test_nobody_there(make) -> None:
    with pytest.raises(AlignmentFailed, match=r"aligner xmlrpc: .* cannot be connected to"):
        make(url=f"http://127.0.0.1:{closed_port()}/RPC2", retries=0).align(SOUND, RATE, "Hi.")


def test_a_slow_aligner_there_is_given_up_here(make) -> None:
    slow = SlowAligner()
    with serving(slow, workers=2) as server:
        aligner = make(url=f"http://127.0.0.1:{server.server_port}/RPC2", seconds=1.5)
        with pytest.raises(AlignmentFailed, match=r"no whole answer within 1\.5 s"):
            aligner.align(SOUND, RATE, "wait")
        assert aligner.align(SOUND, RATE, "Hi.").words
        slow.go.set()


def test_closing_ends_a_call(server: OddServer, make) -> None:
    aligner = make(url=server.url, seconds=60)
    server.then(waits)
    failed: list[str] = []

    def align() -> None:
        try:
            aligner.align(SOUND, RATE, "Hi.")
        except AlignmentFailed as error:
            failed.append(error.message)

    thread = threading.Thread(target=align)
    thread.start()
    while not server.asked:
        time.sleep(0.01)
    aligner.close()
    thread.join(10)
    assert failed == ["aligner xmlrpc: it was closed"]


def test_bad_sound_is_not_sent(server: OddServer, make) -> None:
    with pytest.raises(InputError):
        make(url=server.url).align(np.full(100, np.nan, np.float32), RATE, "Hi.")
    assert not server.asked


@pytest.mark.parametrize("options", [{"url": "localhost:8765"}, {"url": ""}, {"seconds": 0}, {"speed": 1}])
def test_wrong_options_are_named(options: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=rf"align\.aligners\.xmlrpc\.{next(iter(options))}"):
        create("xmlrpc", options)
