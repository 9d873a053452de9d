"""What the engines that speak by a server have in common: settings, the list of voices, the question and its answer."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import httpx
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, SecretStr

from app.errors import ConfigError, NotFound, SpeechFailed
from app.exchange import Exchange, ExchangeFailed, Url
from app.speech import Speech
from app.tts.engine import Voice
from app.tts.received_sound import MOST_BYTES, received_sound


def _printable(secret: SecretStr) -> SecretStr:
    text = secret.get_secret_value()
    if not (text.isascii() and text.isprintable()):
        raise ValueError("it travels in a header: printable ASCII characters only")
    return secret


def _named(value: Any) -> Any:
    return {"id": value} if isinstance(value, str) else value


HeaderSecret = Annotated[SecretStr, AfterValidator(_printable)]


class ServerVoice(BaseModel):
    """A voice that a server is said to have; its id alone will do.

    Attributes:
        id: what the server calls it.
        name: for people; the id by default.
        language: BCP 47.
        sex: ``female``, ``male`` or ``""``.
        licence: SPDX identifier, if it is known.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str = Field(min_length=1)
    name: str = ""
    language: str = "en"
    sex: Literal["female", "male", ""] = ""
    licence: str = ""


Voices = Annotated[tuple[Annotated[ServerVoice, BeforeValidator(_named)], ...], Field(min_length=1)]


class ServerOptions(BaseModel):
    """Options of every engine that speaks by a server.

    Attributes:
        url: of the server.
        voices: the default first. The server is not asked: it may not be there yet.
        key: sent as ``Authorization: Bearer …``; or a file that holds it, or an environment variable.
        seconds: limit for one sentence, from the question to the last sample, new trials included. Less than
            ``speech.seconds``, so that some of that is left for finding phone times.
        connect_seconds: limit for one trial to connect.
        retries: further trials after a failed connection or an answer 408, 429 or 5xx.
        rate: samples a second that all sound is brought to, whatever the server sends.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    url: Url
    voices: Voices = (ServerVoice(id="default"),)
    key: HeaderSecret = SecretStr("")
    key_file: Path | None = None
    key_env: str = ""
    seconds: float = Field(default=8.0, gt=0, le=600)
    connect_seconds: float = Field(default=2.0, gt=0, le=60)
    retries: int = Field(default=2, ge=0, le=10)
    rate: int = Field(default=24_000, ge=16_000, le=48_000)


class SpeechServer:
    """A server that speaks. `speech` may be called from several threads.

    Args:
        engine: name of the engine that speaks by it.
        options: of that engine.

    Raises:
        ConfigError: the key is not where it is said to be.
    """

    def __init__(self, engine: str, options: ServerOptions) -> None:
        self._engine = engine
        self._options = options
        self._key = _key(engine, options)
        self._exchange = Exchange(
            seconds=options.seconds,
            connect_seconds=options.connect_seconds,
            retries=options.retries,
            most_bytes=MOST_BYTES,
            secrets=[self._key, httpx.URL(options.url).password],
        )

    def voices(self) -> tuple[Voice, ...]:
        """The voices of the settings, the default first."""
        return tuple(
            Voice(
                each.id, each.name or each.id, each.language, each.sex, self._options.rate, each.licence, self._engine
            )
            for each in self._options.voices
        )

    def voice(self, requested: str) -> str:
        """Id of a voice, of the default one if nothing is requested. Raises NotFound."""
        known = [each.id for each in self._options.voices]
        if requested and requested not in known:
            raise NotFound(
                f"speech engine {self._engine} has no voice {requested!r}",
                field="voice",
                advice=f"It has: {', '.join(known)}. Others are named in speech.engines.{self._engine}.voices.",
            )
        return requested or known[0]

    def speech(
        self,
        method: str,
        url: str,
        *,
        params: Mapping[str, str] | None = None,
        headers: Mapping[str, str] | None = None,
        content: bytes | None = None,
        pcm: bool = False,
    ) -> Speech:
        """Ask for a sentence.

        Args:
            method, url, params, headers, content: of the request; the key is added.
            pcm: see `received_sound`.

        Returns:
            sound without phones and words, which the server does not tell.

        Raises:
            SpeechFailed: names the engine, what was wrong, and what to do.
        """
        key = {"Authorization": f"Bearer {self._key}"} if self._key else {}
        try:
            answer = self._exchange.ask(method, url, params=params, headers={**key, **(headers or {})}, content=content)
        except ExchangeFailed as error:
            raise SpeechFailed(f"speech engine {self._engine}: {error.reason}", advice=error.advice) from error
        return Speech(received_sound(answer, self._engine, self._options.rate, pcm=pcm), self._options.rate, ())

    def close(self) -> None:
        """End all connections. May be called again; the next sentence connects anew."""
        self._exchange.close()


def _key(engine: str, options: ServerOptions) -> str:
    section = f"speech.engines.{engine}"
    given = [name for name in ("key", "key_file", "key_env") if getattr(options, name)]
    if len(given) > 1:
        raise ConfigError(f"{section}: give one of {' and '.join(given)}", field=f"{section}.{given[1]}")
    if options.key_env:
        if not (key := os.environ.get(options.key_env, "")):
            field = f"{section}.key_env"
            raise ConfigError(f"{field}: the environment variable {options.key_env} is not set", field=field)
    elif options.key_file is not None:
        field = f"{section}.key_file"
        try:
            key = options.key_file.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"{field}: {options.key_file} cannot be read ({error})", field=field) from error
    else:
        key = options.key.get_secret_value()
    if not (key.isascii() and key.isprintable()):
        raise ConfigError(f"{section}.{given[0]}: a key has printable ASCII characters only", field=section)
    return key
