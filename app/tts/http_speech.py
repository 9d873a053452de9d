"""Speech by a plain server: text in, a sound file out, as the first Mary had it (Fu 2011, section 5.1).

That server sent 8 kHz. Whatever comes is brought to one rate, without mirror images of the speech above its old limit.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Literal
from urllib.parse import urlencode

from pydantic import Field, model_validator

from app.align.dictionary import NO_LEXICON, Lexicon
from app.errors import NothingToSay
from app.speech import Speech
from app.tts.engine import Voice
from app.tts.speech_server import HeaderSecret, ServerOptions, SpeechServer

HeaderName = Annotated[str, Field(pattern=r"^[!#$%&'*+.^_`|~0-9A-Za-z-]+$")]


class HttpOptions(ServerOptions):
    """See `ServerOptions`.

    Attributes:
        url: the address that speaks.
        method: with GET everything is in the address.
        body: what POST sends: the bare ``text`` in UTF-8, a ``form``, or a ``json`` object.
        parameter: what the text is called in the address, form or object.
        voice_parameter: what the voice's id is called; empty: it is not sent.
        speed_parameter: what the pace is called (1: the voice's own); empty: it is not sent, and cannot be chosen.
        parameters: further ones that are always sent. Whatever the body cannot hold goes into the address.
        headers: further ones, for a key of another kind, say.
    """

    method: Literal["GET", "POST"] = "POST"
    body: Literal["text", "form", "json"] = "text"
    parameter: str = "text"
    voice_parameter: str = ""
    speed_parameter: str = ""
    parameters: Mapping[str, str] = {}
    headers: Mapping[HeaderName, HeaderSecret] = {}

    @model_validator(mode="after")
    def _get_has_no_body(self) -> HttpOptions:
        if self.method == "GET" and "body" in self.model_fields_set:
            raise ValueError("GET has no body: leave body out, or use POST")
        return self


class HttpEngine:
    """See `app.tts.engine.SpeechEngine`. Its sound comes without phone times; a lexicon cannot be sent."""

    name = "http"
    pronounces = False
    Options = HttpOptions

    def __init__(self, options: HttpOptions) -> None:
        self._options = options
        self._server = SpeechServer(self.name, options)

    def voices(self) -> tuple[Voice, ...]:
        return self._server.voices()

    def warm_up(self) -> None:
        """Nothing: the server may not be there yet."""

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:  # noqa: ARG002
        options = self._options
        chosen = self._server.voice(voice)
        if not any(map(str.isalnum, text)):
            raise NothingToSay("the text has nothing to say", field="text")
        fields: dict[str, str | float] = dict(options.parameters)
        if options.voice_parameter:
            fields[options.voice_parameter] = chosen
        if options.speed_parameter:
            fields[options.speed_parameter] = speed
        headers = {name: secret.get_secret_value() for name, secret in options.headers.items()}
        in_address: dict[str, str] = {}
        content: bytes | None = None
        if options.method == "POST" and options.body == "json":
            headers = {"Content-Type": "application/json", **headers}
            content = json.dumps({**fields, options.parameter: text}).encode()
        elif options.method == "POST" and options.body == "form":
            headers = {"Content-Type": "application/x-www-form-urlencoded", **headers}
            content = urlencode({**fields, options.parameter: text}).encode()
        else:
            in_address = {name: str(value) for name, value in fields.items()}
            if options.method == "POST":
                headers = {"Content-Type": "text/plain; charset=utf-8", **headers}
                content = text.encode()
            else:
                in_address[options.parameter] = text
        return self._server.speech(options.method, options.url, params=in_address, headers=headers, content=content)

    def close(self) -> None:
        self._server.close()
