"""What goes over the wire to a remote aligner and back: XML-RPC, as the first Mary asked hers (Fu 2011, section 5.1).

One method, ``align(wav, text[, lexicon])``. docs/speech.md has the format for those who write a server of their own.
"""

from __future__ import annotations

import io
import re
import wave
import xmlrpc.client
from collections.abc import Sequence
from typing import Annotated, Any
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, FiniteFloat, ValidationError

from app.align.aligner import Alignment, assemble
from app.align.dictionary import Lexicon
from app.align.phoneset import Sound
from app.errors import AlignmentFailed, InputError, MaryError, NothingToSay
from app.speech import PHONES, SILENCE, Word

METHOD = "align"
MOST_BYTES = 100_000_000  # of one message: 13 minutes at 48 kHz
TOLERANCE = 0.05  # seconds that times may exceed the sound; programs round differently

NO_WORDS, BAD_INPUT, FAILED = 1, 2, 3
"""Codes of faults: the text has no word that sounds, the sound or text is unusable, the alignment failed."""
NOT_XML, NO_METHOD, BAD_PARAMETERS = -32700, -32601, -32602
"""And those that XML-RPC servers have agreed on."""

_NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class BadMessage(Exception):
    """It is not XML-RPC, or not about an alignment; the message says what is wrong."""


# --- to the server ----------------------------------------------------------------------------------------------------


def call(samples: NDArray[np.float32], rate: int, text: str, lexicon: Lexicon) -> bytes:
    """The request to align a sound: 16-bit WAV, text, and the lexicon if there is one.

    Characters that XML cannot carry (control characters, half characters) are left out of the text.
    """
    parameters: tuple[Any, ...] = (xmlrpc.client.Binary(_wav(samples, rate)), _NOT_IN_XML.sub("", text))
    if lexicon:
        parameters += ({_NOT_IN_XML.sub("", word): list(said) for word, said in lexicon.items()},)
    return xmlrpc.client.dumps(parameters, METHOD).encode()


def read_call(data: bytes) -> tuple[str, tuple[Any, ...]]:
    """Method and parameters of a request; binaries are bytes. Raises BadMessage."""
    try:
        parameters, method = _parsed(data)
    except xmlrpc.client.Fault as error:
        raise BadMessage("a call was expected") from error
    if method is None:
        raise BadMessage("a call was expected")
    return method, parameters


def _wav(samples: NDArray[np.float32], rate: int) -> bytes:
    file = io.BytesIO()
    with wave.open(file, "wb") as writer:
        writer.setnchannels(1)
        writer.setsampwidth(2)
        writer.setframerate(rate)
        writer.writeframes(np.round(np.clip(samples, -1.0, 1.0) * 32767).astype("<i2").tobytes())
    return file.getvalue()


# --- and back ---------------------------------------------------------------------------------------------------------


def answer(alignment: Alignment, aligner: str) -> bytes:
    """An alignment as a response; `aligner` is the name of the one that found it."""
    found = {
        "phones": [[phone.symbol, phone.start, phone.end] for phone in alignment.phones],
        "words": [[word.text, word.start, word.end] for word in alignment.words],
        "guessed": list(alignment.guessed),
        "confidence": alignment.confidence,
        "aligner": aligner,
    }
    return xmlrpc.client.dumps((found,), methodresponse=True).encode()


def listed(methods: Sequence[str]) -> bytes:
    """The names of a server's methods as a response."""
    return xmlrpc.client.dumps((list(methods),), methodresponse=True).encode()


def fault(code: int, message: str) -> bytes:
    """A response that says why there is no alignment."""
    return xmlrpc.client.dumps(xmlrpc.client.Fault(code, _NOT_IN_XML.sub("", message))).encode()


def fault_of(error: Exception) -> bytes:
    """The fault that tells of an aligner's error."""
    if isinstance(error, NothingToSay):
        return fault(NO_WORDS, error.message)
    if isinstance(error, InputError):
        return fault(BAD_INPUT, error.message)
    if isinstance(error, MaryError):
        return fault(FAILED, error.message)
    return fault(FAILED, f"{type(error).__name__}: {error}")


def read_answer(data: bytes, duration: float) -> Alignment:
    """The alignment in a response.

    Args:
        data: the response; ``words``, ``guessed`` and ``confidence`` may be missing, phones may have gaps (silence),
            stress digits and lower case.
        duration: of the sound, seconds.

    Raises:
        NothingToSay, InputError: the server refused the text or the sound.
        AlignmentFailed: the server's aligner failed; the message is the server's own.
        BadMessage: it is something else, or its times cannot be.
    """
    try:
        values, _ = _parsed(data)
    except xmlrpc.client.Fault as told:
        message = str(told.faultString)
        if told.faultCode == NO_WORDS:
            raise NothingToSay(message, field="text") from told
        raise (InputError if told.faultCode == BAD_INPUT else AlignmentFailed)(message) from told
    try:
        found = _Answer.model_validate(values[0] if len(values) == 1 else values)
    except ValidationError as error:
        first = error.errors()[0]
        raise BadMessage(f"{'.'.join(map(str, first['loc'])) or 'it'}: {first['msg']}") from error
    _check_times("phone", found.phones, duration)
    _check_times("word", found.words, duration)
    phones = assemble([Sound(_symbol(name), start, end) for name, start, end in found.phones], (), duration).phones
    if all(phone.symbol == SILENCE for phone in phones):
        raise BadMessage("there is no phone in it")
    words: list[Word] = []
    at = 0.0
    for text, start, end in found.words:
        start, end = max(at, start), min(end, duration)
        if start < end:
            words.append(Word(text, start, end))
            at = end
    return Alignment(phones, tuple(words), tuple(found.guessed), found.confidence)


Timed = tuple[str, FiniteFloat, FiniteFloat]


class _Answer(BaseModel):
    phones: list[Timed]
    words: list[Timed] = []
    guessed: list[str] = []
    confidence: Annotated[float, Field(ge=0, le=1)] = 1.0


def _symbol(name: str) -> str:
    symbol = name.upper().rstrip("012")
    if symbol in ("", "SP", "SPN", "SILENCE", "<SIL>"):
        return SILENCE
    if symbol not in PHONES:
        raise BadMessage(f"{name!r} is no phone")
    return symbol


def _check_times(kind: str, timed: Sequence[Timed], duration: float) -> None:
    at = 0.0
    for name, start, end in timed:
        if not (at - TOLERANCE <= start <= end <= duration + TOLERANCE):
            raise BadMessage(f"{kind} {name!r} from {start:.3f} to {end:.3f} s is out of order in {duration:.3f} s")
        at = end


# --- XML --------------------------------------------------------------------------------------------------------------


def _parsed(data: bytes) -> tuple[tuple[Any, ...], str | None]:
    """Values, and the method if it is a call. Raises BadMessage, or xmlrpc.client.Fault if it is one.

    The library's own parser takes document types, whose entities can stand for gigabytes; this one does not.
    """
    reader = xmlrpc.client.Unmarshaller(use_builtin_types=True)
    reader.xml("", None)  # the parser has decoded what it is given
    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = _refuse_document_type
    parser.StartElementHandler = reader.start
    parser.EndElementHandler = reader.end
    parser.CharacterDataHandler = reader.data
    try:
        parser.Parse(data, True)
        values = reader.close()
    except (xmlrpc.client.Fault, BadMessage):
        raise
    except Exception as error:  # the library's reader raises whatever it stumbles over
        raise BadMessage(f"it is no XML-RPC ({type(error).__name__}: {error})") from error
    return tuple(values), reader.getmethodname()


def _refuse_document_type(*_: object) -> None:
    raise BadMessage("it has a document type, which XML-RPC has not")
