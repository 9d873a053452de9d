"""Speech engines by name: the ones here and those that other packages add by the entry point group ``mary.tts``."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from app.errors import MissingExtra, NotFound, SpeechFailed
from app.tts.engine import SpeechEngine

GROUP = "mary.tts"

# Imported only when asked for: the models' libraries are heavy.
_OURS = {"hibari": ("app.tts.hibari", "HibariEngine"), "mock": ("app.tts.mock", "MockEngine")}


def names() -> tuple[str, ...]:
    """Names of all engines that can be created, ours first."""
    return (*_OURS, *sorted(set(_theirs()) - set(_OURS)))


def create(name: str) -> SpeechEngine:
    """A new engine; nothing is loaded before its `warm_up`.

    Raises:
        NotFound: no engine of this name; the advice lists the known ones.
        MissingExtra: the engine's library is not installed.
        SpeechFailed: the entry point does not make a speech engine.
    """
    try:
        if name in _OURS:
            module, attribute = _OURS[name]
            factory: Any = getattr(import_module(module), attribute)
        elif name in (theirs := _theirs()):
            factory = theirs[name].load()
        else:
            raise NotFound(
                f"there is no speech engine {name!r}", field="speech.engine", advice=f"Known: {', '.join(names())}."
            )
        engine = factory()
    except ImportError as error:
        raise MissingExtra(
            f"speech engine {name} needs {error.name or error}, which is not installed",
            advice=f"pip install 'mary[{name}]' or the package that {name} comes from.",
            field="speech.engine",
        ) from error
    if not isinstance(engine, SpeechEngine):
        raise SpeechFailed(
            f"{name} is no speech engine: {type(engine).__name__} lacks name, voices, warm_up or speak",
            advice=f"Correct the entry point {name} in the group {GROUP}.",
        )
    return engine


def _theirs() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUP)}
