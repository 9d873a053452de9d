"""Speech engines by name: the ones here and those that other packages add by the entry point group ``mary.tts``.

Nothing is loaded before it is used.
"""

from __future__ import annotations

from app.errors import SpeechFailed
from app.plugins import Plugins
from app.tts.engine import SpeechEngine

_PLUGINS: Plugins[SpeechEngine] = Plugins(
    kind="speech engine",
    group="mary.tts",
    field="speech.engine",
    ours={
        "hibari": ("app.tts.hibari", "HibariEngine"),
        "espeak": ("app.tts.espeak", "EspeakEngine"),
        "piper": ("app.tts.piper_voice", "PiperEngine"),
        "pyttsx3": ("app.tts.pyttsx3_voice", "Pyttsx3Engine"),
        "openai": ("app.tts.openai_speech", "OpenAiEngine"),
        "http": ("app.tts.http_speech", "HttpEngine"),
        "mock": ("app.tts.mock", "MockEngine"),
    },
    protocol=SpeechEngine,
    broken=SpeechFailed,
    section="speech.engines",
)

names = _PLUGINS.names
create = _PLUGINS.create
