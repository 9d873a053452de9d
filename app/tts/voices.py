"""The voices of every engine there is, whether it can speak here or not."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from app.errors import MaryError
from app.tts.engine import Voice
from app.tts.registry import create, names


@dataclass(frozen=True, slots=True)
class EngineVoices:
    """One engine.

    Attributes:
        engine: its name.
        voices: its own default first; none if it cannot be made.
        missing: why it cannot be made and what to do about it, otherwise ``""``.
    """

    engine: str
    voices: tuple[Voice, ...]
    missing: str = ""


def every_voice(options: Mapping[str, Mapping[str, Any]]) -> tuple[EngineVoices, ...]:
    """All engines that are known by name, with their voices.

    Args:
        options: of each engine, by name (`speech.engines`).
    """
    return tuple(_voices(name, options.get(name, {})) for name in names())


def _voices(name: str, options: Mapping[str, Any]) -> EngineVoices:
    try:
        with closing(create(name, options)) as engine:
            return EngineVoices(name, engine.voices())
    except MaryError as error:
        return EngineVoices(name, (), " ".join(filter(None, (f"{error.message}.", error.advice))))
