from __future__ import annotations

import io
import wave
import xmlrpc.client
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.align.aligner import Alignment
from app.align.alignment_message import BadMessage, answer, call, fault, fault_of, read_answer, read_call
from app.errors import AlignmentFailed, InputError, MaryError, NothingToSay
from app.speech import PHONES, SILENCE, Phone, Word

FOUND = Alignment(
    (Phone(SILENCE, 0.0, 0.1), Phone("HH", 0.1, 1 / 3), Phone("AY", 1 / 3, 0.9), Phone(SILENCE, 0.9, 1.0)),
    (Word("“Hi” & <bye>", 0.1, 0.9),),
    ("“Hi” & <bye>",),
    0.987654321,
)


def response(**found: Any) -> bytes:
    return xmlrpc.client.dumps((found,), methodresponse=True).encode()


def test_a_call_by_the_eyes_of_the_library() -> None:
    samples = np.array([0.0, 0.5, -0.5, 1.0, -2.0], np.float32)
    data = call(samples, 16_000, "Hi & <b> \x00there\ud800", {"mary": ("M", "EH", "R", "IY")})
    (wav, text, lexicon), method = xmlrpc.client.loads(data, use_builtin_types=True)
    assert (method, text, lexicon) == ("align", "Hi & <b> there", {"mary": ["M", "EH", "R", "IY"]})
    with wave.open(io.BytesIO(wav)) as file:
        assert (file.getnchannels(), file.getsampwidth(), file.getframerate()) == (1, 2, 16_000)
        assert np.frombuffer(file.readframes(9), "<i2").tolist() == [0, 16384, -16384, 32767, -32767]
    assert read_call(data) == ("align", (wav, text, lexicon))


def test_a_call_without_a_lexicon_has_two_parameters() -> None:
    assert len(read_call(call(np.zeros(10, np.float32), 8_000, "Hi", {}))[1]) == 2


def test_an_alignment_survives_exactly() -> None:
    assert read_answer(answer(FOUND, "mock"), 1.0) == FOUND


def test_other_servers_may_say_less_and_write_otherwise() -> None:
    phones = [["hh", 0.1, 0.3], ["AY1", 0.3, 0.9], ["sp", 0.9, 1.0]]
    found = read_answer(response(phones=phones), 1.0)
    assert found == Alignment(
        (FOUND.phones[0], Phone("HH", 0.1, 0.3), Phone("AY", 0.3, 0.9), FOUND.phones[3]), (), (), 1.0
    )
    whole_numbers = read_answer(response(phones=[["AA", 0, 1]], words=[["ah", 0, 1]]), 1.0)
    assert whole_numbers.words == (Word("ah", 0.0, 1.0),)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "no XML-RPC"),
        (b"<html><body>hi</body></html>", "no XML-RPC"),
        (b'{"phones": []}', "no XML-RPC"),
        (answer(FOUND, "mock")[:-200], "no XML-RPC"),
        (xmlrpc.client.dumps((1, 2), methodresponse=False).encode(), "valid"),
        (xmlrpc.client.dumps(("fine",), methodresponse=True).encode(), "valid"),
        (response(), "phones"),
        (response(phones=[]), "no phone in it"),
        (response(phones=[["SIL", 0.0, 1.0]]), "no phone in it"),
        (response(phones=[["AA", 0.0]]), r"phones\.0"),
        (response(phones=[["AA", "0", "x"]]), r"phones\.0"),
        (response(phones=[["AA", 0.0, float("nan")]]), r"phones\.0"),
        (response(phones=[["QQ", 0.0, 1.0]]), "'QQ' is no phone"),
        (response(phones=[["AA", 0.5, 0.2]]), "out of order"),
        (response(phones=[["AA", 0.0, 9.0]]), "out of order"),
        (response(phones=[["AA", 0.5, 0.9], ["B", 0.1, 0.2]]), "out of order"),
        (response(phones=[["AA", 0.0, 1.0]], words=[["a", 0.0, 7.0]]), "word 'a'"),
        (response(phones=[["AA", 0.0, 1.0]], confidence=7.0), "confidence"),
        (
            b'<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]><methodResponse><params><param><value>&b;</value>'
            b"</param></params></methodResponse>",
            "document type",
        ),
        (
            b'<!DOCTYPE x SYSTEM "file:///etc/passwd"><methodResponse><params><param><value>&x;</value></param>'
            b"</params></methodResponse>",
            "document type",
        ),
    ],
)
def test_anything_else_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(BadMessage, match=said):
        read_answer(data, 1.0)


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (NothingToSay("no words"), NothingToSay),
        (InputError("sound is empty"), InputError),
        (AlignmentFailed("it does not say that"), AlignmentFailed),
        (RuntimeError("odd \x01 thing"), AlignmentFailed),
    ],
)
def test_errors_survive(error: Exception, kind: type[MaryError]) -> None:
    with pytest.raises(kind) as caught:
        read_answer(fault_of(error), 1.0)
    assert type(caught.value) is kind
    assert str(error).replace("\x01", "") in caught.value.message


def test_faults_of_other_servers_are_failures() -> None:
    with pytest.raises(AlignmentFailed, match="word not in dictionary: qwyx"):
        read_answer(fault(17, "word not in dictionary: qwyx"), 1.0)


@given(st.binary(max_size=200), st.booleans())
def test_any_bytes_are_refused(data: bytes, wrapped: bool) -> None:
    start, end = b"<methodResponse><params><param><value>", b"</value></param></params></methodResponse>"
    with pytest.raises(BadMessage):
        read_answer(start + data + end if wrapped else data, 1.0)
    with pytest.raises(BadMessage):
        read_call(data)


def test_a_fault_is_no_call() -> None:
    with pytest.raises(BadMessage, match="a call was expected"):
        read_call(fault(3, "no"))


@given(st.text(), st.lists(st.tuples(st.sampled_from(PHONES[:-1]), st.floats(0.01, 0.3)), min_size=1))
def test_any_alignment_survives(text: str, lengths: list[tuple[str, float]]) -> None:
    written = "".join(letter for letter in text if letter.isprintable())
    phones, at = [], 0.0
    for symbol, length in lengths:
        phones.append(Phone(symbol, at, at + length))
        at += length
    found = Alignment(tuple(phones), (Word(written, 0.0, at),), (written,), 0.5)
    assert read_answer(answer(found, "mock"), at) == found
