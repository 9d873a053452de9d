"""The messages that a client may send in a conversation over a WebSocket, checked like the bodies of requests.

A message is a JSON object whose `type` says what it is. Sound comes as binary messages, after an `audio` message.
"""

from __future__ import annotations

import json
from typing import Any, Literal

from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, Field, ValidationError

from app.api.schemas import Lexicon, Markup, Name, Phase, Renderer, Request, Speed, Strict, Text, Trajectory
from app.errors import InputError

Rate = Literal[16_000, 24_000, 48_000]


class TextMessage(Request):
    """More of a text that is being written; the first one says with which voice, lexicon and so on."""

    type: Literal["text"]
    text: Text
    trajectory: Trajectory | None = None
    renderer: Renderer | None = None
    voice: Name | None = None
    speed: Speed = 1.0
    lexicon: Lexicon = Field(default={})
    phase: Phase | None = None


class AudioMessage(Request):
    """Sound follows: binary messages of 16-bit little-endian mono samples, until `end`."""

    type: Literal["audio"]
    rate: Rate = Field(description="Samples a second.")
    transcript: Text | None = Field(default=None, description="What is said in it, if that is known.")
    trajectory: Trajectory | None = None
    renderer: Renderer | None = None
    phase: Phase | None = None


class FlushMessage(Request):
    """Speak what has come so far, without waiting for the end of its clause."""

    type: Literal["flush"]


class EndMessage(Request):
    """The text or sound that was begun is complete."""

    type: Literal["end"]


class InterruptMessage(Request):
    """Fall silent, and forget what is queued and what was begun."""

    type: Literal["interrupt"]


class SayMessage(Request):
    """A whole text, as with `POST …/say`."""

    type: Literal["say"]
    text: Text
    interrupt: bool = False
    trajectory: Trajectory | None = None
    renderer: Renderer | None = None
    voice: Name | None = None
    speed: Speed = 1.0
    lexicon: Lexicon = Field(default={})
    strict: Strict = False
    markup: Markup = "auto"
    phase: Phase | None = None


Message = TextMessage | AudioMessage | FlushMessage | EndMessage | InterruptMessage | SayMessage

_BY_TYPE: dict[str, type[BaseModel]] = {
    "text": TextMessage,
    "audio": AudioMessage,
    "flush": FlushMessage,
    "end": EndMessage,
    "interrupt": InterruptMessage,
    "say": SayMessage,
}


def read(text: str) -> Message:
    """The message in a text frame.

    Raises:
        InputError: it is no JSON object, or of no known type.
        RequestValidationError: one of its fields is missing, unknown or out of range.
    """
    try:
        content: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        where = f" at character {error.pos}" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(
            f"the message is not valid JSON{where}", advice='Send {"type": "text", "text": "…"}.'
        ) from error
    kind = content.get("type") if isinstance(content, dict) else None
    model = _BY_TYPE.get(kind) if isinstance(kind, str) else None
    if model is None:
        raise InputError("the message has no known type", field="type", advice=f"Known: {', '.join(_BY_TYPE)}.")
    try:
        return model.model_validate(content)  # type: ignore[return-value]
    except ValidationError as error:
        faults = [{**fault, "loc": ("message", *fault["loc"])} for fault in error.errors(include_url=False)]
        raise RequestValidationError(faults) from error
