"""Speech by any server that speaks OpenAI's protocol: ``POST /v1/audio/speech`` with JSON, sound as the answer.

OpenAI's own, and many that one runs oneself (Kokoro-FastAPI, Speaches, LocalAI, vLLM ...).
"""

from __future__ import annotations

import json
from typing import Literal

import httpx

from app.align.dictionary import NO_LEXICON, Lexicon
from app.errors import NothingToSay
from app.exchange import Url
from app.speech import Speech
from app.tts.engine import Voice
from app.tts.speech_server import ServerOptions, ServerVoice, SpeechServer, Voices

PATH = "/audio/speech"


class OpenAiOptions(ServerOptions):
    """See `ServerOptions`.

    Attributes:
        url: base address of the server, as OpenAI's clients take it: with ``/v1``.
        model: what the server calls it.
        response_format: ``wav``; ``pcm`` (24 kHz, or the rate that the answer's media type names) has no header that
            could be wrong; ``flac`` and ``mp3`` are smaller.
        instructions: how to speak, for models that take it.
    """

    url: Url = "https://api.openai.com/v1"
    model: str = "tts-1"
    voices: Voices = (ServerVoice(id="alloy", name="Alloy"),)
    response_format: Literal["wav", "pcm", "mp3", "flac"] = "wav"
    instructions: str = ""


class OpenAiEngine:
    """See `app.tts.engine.SpeechEngine`. Its sound comes without phone times; a lexicon cannot be sent."""

    name = "openai"
    pronounces = False
    Options = OpenAiOptions

    def __init__(self, options: OpenAiOptions = OpenAiOptions()) -> None:  # noqa: B008 (it is frozen)
        self._options = options
        self._server = SpeechServer(self.name, options)
        self._url = _speech_url(options.url)

    def voices(self) -> tuple[Voice, ...]:
        return self._server.voices()

    def warm_up(self) -> None:
        """Nothing: the server may not be there yet, and asking it for speech may cost money."""

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:  # noqa: ARG002
        chosen = self._server.voice(voice)
        if not any(map(str.isalnum, text)):
            raise NothingToSay("the text has nothing to say", field="text")
        asked = {
            "model": self._options.model,
            "input": text,
            "voice": chosen,
            "response_format": self._options.response_format,
            "speed": speed,
        }
        if self._options.instructions:
            asked["instructions"] = self._options.instructions
        return self._server.speech(
            "POST",
            self._url,
            headers={"Content-Type": "application/json"},
            content=json.dumps(asked).encode(),
            pcm=self._options.response_format == "pcm",
        )

    def close(self) -> None:
        self._server.close()


def _speech_url(base: str) -> str:
    """The address that speaks, of a base address with or without ``/v1``, or of itself."""
    url = httpx.URL(base)
    path = url.path.rstrip("/")
    if not path.endswith(PATH):
        path = (path or "/v1") + PATH
    return str(url.copy_with(path=path))
