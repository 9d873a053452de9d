"""`config.yaml` as typed settings; environment variables (`MARY_SECTION__KEY`) override it, unknown keys are errors."""

from __future__ import annotations

import ipaddress
import os
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict, SettingsError

from app.align.dictionary import read_lexicon
from app.errors import ConfigError, InputError

ENVIRONMENT_PREFIX = "MARY_"

Preset = Literal[
    "ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow", "placebo"
]
"""x264's presets, from quick to thorough."""

_RTMP = r"^(rtmps?://[^\s/]+/[^\s?]+)?$"

INSTALLED = Path(__file__).resolve().parent.parent / "config.yaml"
"""The settings of the repository that the package is installed from."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def _origin(text: str) -> str:
    if text != "*" and not re.fullmatch(r"https?://[a-z0-9.-]+(:\d+)?|https?://\[[0-9a-f:]+\](:\d+)?", text):
        raise ValueError('not an origin; they look like "https://www.example.org", without a path, or "*" for all')
    return text


def _address(text: str) -> str:
    try:
        ipaddress.ip_address(text)
    except ValueError as error:
        raise ValueError("not an IP address; give the server's public IPv4 or IPv6 address, no host name") from error
    return text


def _ports(text: str) -> str:
    match = re.fullmatch(r"(\d{1,5})-(\d{1,5})", text)
    if text and not (match and 1024 <= int(match[1]) <= int(match[2]) <= 65535):
        raise ValueError('not a range of ports between 1024 and 65535, e.g. "50000-50100"')
    return text


def _listed(value: object) -> object:
    return [value] if isinstance(value, str) else value


class ServerSettings(_Section):
    host: str = "0.0.0.0"
    port: int = Field(default=8080, ge=0, le=65535)
    shutdown_seconds: float = Field(default=2.0, gt=0)
    cors_origins: list[Annotated[str, AfterValidator(_origin)]] = []


class AvatarSettings(_Section):
    folder: Path = Path("avatars")
    default: str = "mary"


class SpeechSettings(_Section):
    engine: str = "hibari"
    voice: str = ""
    seconds: float = Field(default=10.0, gt=0)
    aligner: str = "auto"
    fallback: str = ""
    cache_mb: float = Field(default=32.0, ge=0)
    lexicon: dict[str, str] = {}
    engines: dict[str, dict[str, Any]] = {}

    @field_validator("lexicon")
    @classmethod
    def _pronounceable(cls, lexicon: dict[str, str]) -> dict[str, str]:
        try:
            read_lexicon(lexicon)
        except InputError as error:
            raise ValueError(error.message) from error
        return lexicon


class AlignSettings(_Section):
    engine: str = "pocketsphinx"
    recogniser: str = "hama"
    aligners: dict[str, dict[str, Any]] = {}


class EngineSettings(_Section):
    trajectory: str = ""
    renderer: Literal["", "fast", "reference"] = ""
    workers: int = Field(default=0, ge=0, le=256)
    look_ahead: float = Field(default=0.4, gt=0, le=5)
    encode_ahead: float = Field(default=0.08, ge=0, le=1)


class StreamSettings(_Section):
    preset: Preset = "superfast"
    crf: float = Field(default=21, ge=0, le=51)
    max_kbps: int = Field(default=2500, gt=0)
    keyframe_seconds: float = Field(default=2.0, gt=0, le=8)  # less than `Broadcast` keeps for late viewers
    start_seconds: float = Field(default=10.0, gt=0)
    idle_seconds: float = Field(default=60.0, gt=0)
    keep_seconds: float = Field(default=600.0, ge=0)
    max_streams: int = Field(default=32, gt=0)
    max_viewers: int = Field(default=64, gt=0)
    queue_seconds: float = Field(default=4.0, gt=0)


IceUrl = Annotated[str, Field(pattern=r"^(stun|stuns|turn|turns):[^\s<>\"\\]+$")]
Printable = Annotated[str, Field(pattern=r"^[ -~]*$")]  # it travels in a header


class IceServer(_Section):
    """A STUN or TURN server that viewers are told of."""

    urls: Annotated[list[IceUrl], BeforeValidator(_listed), Field(min_length=1)]
    username: Printable | None = None
    credential: Printable | None = None


class TurnServer(_Section):
    """A TURN server through which this server itself can be reached."""

    url: str = Field(
        pattern=r"^(turn:[^?:\s]+(:\d+)?(\?transport=(udp|tcp))?|turns:[^?:\s]+(:\d+)?(\?transport=tcp)?)$"
    )
    username: str
    credential: str


class WebrtcSettings(_Section):
    addresses: list[Annotated[str, AfterValidator(_address)]] = []
    ports: Annotated[str, AfterValidator(_ports)] = ""
    loopback: bool = True
    stun: str = Field(default="", pattern=r"^(stun:[^?:\s]+(:\d+)?)?$")
    turn: TurnServer | None = None
    max_viewers: int = Field(default=64, gt=0)
    ice_servers: list[IceServer] = []

    @property
    def port_range(self) -> range | None:
        """`ports` as numbers; None: any."""
        if not self.ports:
            return None
        first, last = map(int, self.ports.split("-"))
        return range(first, last + 1)


class PushSettings(_Section):
    rtmp: str = Field(default="", pattern=_RTMP)
    rtmp_play: str = Field(default="", pattern=_RTMP)
    hosts: list[str] = []
    max: int = Field(default=16, gt=0)
    stall_seconds: float = Field(default=5.0, gt=0)
    retry_seconds: float = Field(default=1.0, gt=0)
    retry_max_seconds: float = Field(default=30.0, gt=0)
    give_up_seconds: float = Field(default=300.0, ge=0)


class RenderSettings(_Section):
    preset: Preset = "medium"
    crf: float = Field(default=16, ge=0, le=51)


class LimitSettings(_Section):
    text: int = Field(default=10_000, gt=0)
    sdp: int = Field(default=65_536, gt=0)
    audio_bytes: int = Field(default=50_000_000, gt=0)
    audio_seconds: float = Field(default=300.0, gt=0)
    live_sounds: int = Field(default=4, gt=0)
    live_audio_seconds: float = Field(default=60.0, gt=1)


class Settings(BaseSettings):
    """All settings, validated and frozen. `load` is the way to get one."""

    model_config = SettingsConfigDict(
        env_prefix=ENVIRONMENT_PREFIX, env_nested_delimiter="__", extra="forbid", frozen=True
    )

    server: ServerSettings = ServerSettings()
    avatars: AvatarSettings = AvatarSettings()
    speech: SpeechSettings = SpeechSettings()
    align: AlignSettings = AlignSettings()
    engine: EngineSettings = EngineSettings()
    stream: StreamSettings = StreamSettings()
    webrtc: WebrtcSettings = WebrtcSettings()
    push: PushSettings = PushSettings()
    render: RenderSettings = RenderSettings()
    limits: LimitSettings = LimitSettings()

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],  # noqa: ARG003
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,  # noqa: ARG003
        file_secret_settings: PydanticBaseSettingsSource,  # noqa: ARG003
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        return (env_settings, init_settings)  # the environment wins over the file


def load(path: Path | None = None) -> Settings:
    """Read settings from a file and the environment.

    Args:
        path: the file; None: `config.yaml` here, else the repository's own, else the defaults alone. Paths in it are
            relative to it.

    Raises:
        ConfigError: the file is missing or no YAML mapping, a key is unknown or a value is wrong.
    """
    source = path or next((file for file in (Path("config.yaml"), INSTALLED) if file.exists()), None)
    values = _read(source) if source else {}
    _refuse_unknown_variables(Settings)
    try:
        settings = Settings(**values)
    except ValidationError as error:
        raise _explained(error, source) from error
    except SettingsError as error:
        names = ", ".join(name for name in os.environ if name.startswith(ENVIRONMENT_PREFIX))
        raise ConfigError(
            f"one of {names} is not valid JSON: {error.__cause__}",
            advice="Lists and whole sections in variables are written as JSON.",
        ) from error
    folder = settings.avatars.folder
    if source is None or folder.is_absolute() or f"{ENVIRONMENT_PREFIX}AVATARS__FOLDER" in map(str.upper, os.environ):
        return settings
    return settings.model_copy(
        update={"avatars": settings.avatars.model_copy(update={"folder": source.parent / folder})}
    )


def _read(source: Path) -> dict[str, Any]:
    try:
        values = yaml.safe_load(source.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{source} cannot be read: {error.strerror}", advice="Name a readable file.") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{source} is not valid YAML: {error}") from error
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ConfigError(f"{source} must hold sections with keys, not {type(values).__name__}")
    return {str(key): value for key, value in values.items()}


def _explained(error: ValidationError, source: Path | None) -> ConfigError:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    variable = ENVIRONMENT_PREFIX + "__".join(str(part) for part in first["loc"][:2]).upper()
    place = variable if variable in os.environ else str(source or "settings")
    unknown = first["type"] == "extra_forbidden"
    value = "" if unknown or isinstance(first["input"], dict) else f" (got {first['input']!r})"
    message = "unknown key" if unknown else first["msg"].removeprefix("Value error, ")
    return ConfigError(
        f"{place}: {key}: {message}{value}",
        field=key,
        advice=f"Correct {place}." if place == variable else f"Correct {key} in {place} or set {variable}.",
    )


def _refuse_unknown_variables(settings: type[BaseSettings]) -> None:
    for name in os.environ:
        if not name.startswith(ENVIRONMENT_PREFIX):
            continue
        section, _, key = name[len(ENVIRONMENT_PREFIX) :].lower().partition("__")
        field = settings.model_fields.get(section)
        model = field.annotation if field else None
        keys = model.model_fields if isinstance(model, type) and issubclass(model, BaseModel) else {}
        if field is None or (key and key.split("__")[0] not in keys):
            raise ConfigError(
                f"unknown environment variable {name}", field=name, advice="See config.yaml for the keys."
            )
