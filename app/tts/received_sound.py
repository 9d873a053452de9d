"""The sound in what a speech server sends, which may as well be an error, a page, silence, or half a file."""

from __future__ import annotations

import io
import json
import re
import struct

import numpy as np
import soxr
from numpy.typing import NDArray

from app.align.sound_file import FASTEST, SLOWEST, read_sound
from app.answer import Answer, complaint_of
from app.errors import InputError, SpeechFailed
from app.tts.timed import QUIETEST

PCM_RATE = 24_000  # samples a second of headerless sound, as OpenAI sends it
LONGEST = 300.0  # seconds: nobody takes longer over a sentence
MOST_BYTES = 64_000_000  # of one sentence; a WAV header that promises more does not know the length
_RATE = re.compile(r"\brate=(\d{1,6})\b")


def received_sound(answer: Answer, engine: str, rate: int, *, pcm: bool = False) -> NDArray[np.float32]:
    """Decode what a server sent.

    Args:
        answer: WAV of any kind, also one whose header does not know its length because it was sent while it was made,
            or what else `app.align.sound_file` reads.
        engine: name of the speech engine.
        rate: samples a second to bring it to.
        pcm: sound without a header is 16-bit mono, little-endian.

    Returns:
        mono samples in [-1, 1], shape (n,).

    Raises:
        SpeechFailed: names the engine and what was sent instead of sound.
    """
    try:
        samples, own_rate = _decoded(answer, pcm)
    except InputError as error:
        raise SpeechFailed(f"speech engine {engine}: {error.message}", advice=error.advice) from error
    if float(np.abs(samples).max()) < QUIETEST:
        raise SpeechFailed(
            f"speech engine {engine} made no sound: its server sent {len(samples) / own_rate:.1f} s of silence",
            advice="Try another voice or model of that server.",
        )
    if own_rate != rate:
        samples = soxr.resample(samples, own_rate, rate, "HQ")  # a filter that leaves no mirror images above 4 kHz
    return np.clip(samples, -1.0, 1.0).astype(np.float32)


def _decoded(answer: Answer, pcm: bool) -> tuple[NDArray[np.float32], int]:
    body = answer.body
    if not body:
        raise InputError("its server sent an empty answer", advice="See the server's log.")
    if (what := _text_instead(answer)) is not None:
        complaint = complaint_of(answer)
        said = f": “{complaint}”" if complaint else ""
        raise InputError(f"its server sent {what} instead of sound{said}", advice="Is url the address that speaks?")
    if body[:4] == b"RIFF":
        body = _with_its_length(body)
    elif pcm and not answer.kind.startswith(("audio/mp", "audio/flac", "audio/ogg", "audio/aac")):
        return _headerless(body, answer.kind)
    try:
        return read_sound(io.BytesIO(body), longest=LONGEST, name="what its server sent")
    except InputError as error:
        advice = "Choose WAV, FLAC or MP3 at the server."
        raise InputError(f"{error.message}{_told_kind(answer)}", advice=advice) from error


def _text_instead(answer: Answer) -> str | None:
    """What was sent, if it is text."""
    start = answer.body[:64].lstrip().lower()
    if "html" in answer.kind or start.startswith((b"<!doctype", b"<html")):
        return "a web page"
    if "json" in answer.kind:
        return "JSON"
    if answer.kind.startswith("text/"):
        return "text"
    if start[:1] == b"{":
        try:
            json.loads(answer.body)
        except ValueError:
            return None  # samples that look like a brace
        return "JSON"
    return None


def _headerless(body: bytes, kind: str) -> tuple[NDArray[np.float32], int]:
    if len(body) % 2:
        raise InputError("its server sent half a sample at the end: the sound is cut off", advice="Try again.")
    found = _RATE.search(kind)
    rate = int(found[1]) if found else PCM_RATE
    if not SLOWEST <= rate <= FASTEST:
        raise InputError(f"its server sent {rate:,} samples a second", advice="From 8,000 to 96,000 are taken.")
    if len(body) > LONGEST * rate * 2:
        raise InputError(f"its server sent more than {LONGEST:g} s of sound", advice="Is response_format right?")
    return np.frombuffer(body, "<i2").astype(np.float32) / np.float32(32_768), rate


def _with_its_length(body: bytes) -> bytes:
    """A WAV whose header has the true length of its sound.

    Raises:
        InputError: less than the header promises is there.
    """
    at = 12
    while at + 8 <= len(body):
        name, promised = struct.unpack_from("<4sI", body, at)
        at += 8
        if name != b"data":
            at += promised + promised % 2
            continue
        there = len(body) - at
        if promised <= there and promised:
            return body
        if promised and promised <= MOST_BYTES:
            raise InputError(
                f"its server sent {there:,} of {promised:,} bytes of sound: it is cut off", advice="See its log."
            )
        whole = bytearray(body)
        struct.pack_into("<I", whole, 4, len(body) - 8)
        struct.pack_into("<I", whole, at - 4, there)
        return bytes(whole)
    return body


def _told_kind(answer: Answer) -> str:
    return f" (it is called {answer.kind.partition(';')[0]})" if answer.kind else ""
