"""Speech engines by name: the ones here and those that other packages add by the entry point group ``mary.tts``."""

from __future__ import annotations

from app.errors import SpeechFailed
from app.plugins import Plugins
from app.tts.engine import SpeechEngine

GROUP = "mary.tts"

_PLUGINS = Plugins(
    "speech engine",
    GROUP,
    "speech.engine",
    {"hibari": ("app.tts.hibari", "HibariEngine"), "mock": ("app.tts.mock", "MockEngine")},
)

names = _PLUGINS.names


def create(name: str) -> SpeechEngine:
    """A new engine; nothing is loaded before its `warm_up`.

    Raises:
        NotFound: no engine of this name; the advice lists the known ones.
        MissingExtra: the engine's library is not installed.
        SpeechFailed: the entry point does not make a speech engine.
    """
    engine = _PLUGINS.make(name)
    if not isinstance(engine, SpeechEngine):
        raise SpeechFailed(
            f"{name} is no speech engine: {type(engine).__name__} lacks name, voices, warm_up or speak",
            advice=f"Correct the entry point {name} in the group {GROUP}.",
        )
    return engine
