"""What a server answers, and what of it can be told to people if it is not what was asked for."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

MOST_COMPLAINT = 65_536  # bytes of an answer that are searched for a message
LONGEST_EXCERPT = 200  # characters of it that are told


@dataclass(frozen=True, slots=True)
class Answer:
    """What a server sent.

    Attributes:
        body: all of it.
        kind: its media type with parameters, lower case; empty if the server does not tell.
    """

    body: bytes
    kind: str


def complaint_of(answer: Answer) -> str:
    """What an answer says that is wrong, if it is JSON, HTML or plain text: one line, at most 200 characters."""
    text = answer.body[:MOST_COMPLAINT].decode("utf-8", "replace").strip()
    if "html" in answer.kind or text[:1] == "<":
        title = re.search(r"<title[^>]*>(.*?)</title>", text, re.DOTALL | re.IGNORECASE)
        text = title[1] if title else re.sub(r"<[^>]*>", " ", text)
    elif text[:1] in ("{", "["):
        with suppress(ValueError, RecursionError):
            text = _told(json.loads(text))
    elif answer.kind and not answer.kind.startswith("text/"):
        return ""
    line = " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())
    return line if len(line) <= LONGEST_EXCERPT else line[: LONGEST_EXCERPT - 1] + "…"


def _told(value: Any) -> str:
    """The message in a JSON answer, where OpenAI, FastAPI and most others have theirs."""
    if isinstance(value, str):
        return value
    if isinstance(value, list):
        return _told(value[0]) if value else ""
    if isinstance(value, dict):
        for key in ("error", "message", "detail", "msg", "title"):
            if value.get(key):
                return _told(value[key])
    return ""
