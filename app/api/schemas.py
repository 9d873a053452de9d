"""What requests may hold and what answers do. Unknown fields are errors: a misspelt option must not be ignored."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import UploadFile
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Json


def _whole(text: str) -> str:
    """Join or replace lone surrogates, which JSON can carry and UTF-8 cannot."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


Text = Annotated[str, AfterValidator(_whole), Field(description="What to say, in English.", examples=["Hello, world."])]
Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_whole)]
Url = Annotated[str, AfterValidator(_whole)]
Token = Annotated[str, AfterValidator(_whole), Field(min_length=1, description="Bearer token of the WHIP server.")]
Trajectory = Annotated[
    Name, Field(description="What moves the mouth: see `trajectories` of the avatar.", examples=["gaussian"])
]
Renderer = Annotated[Name, Field(description="What draws the mouth: see `renderers`.", examples=["fast"])]
Speed = Annotated[float, Field(ge=0.5, le=2.0, allow_inf_nan=False, description="1 is the voice's own pace.")]


Lexicon = Annotated[
    dict[Name, Name],
    Field(
        max_length=1000,
        description="How words are to be said: ARPAbet, e.g. N UW Y EH N.",
        examples=[{"Nguyen": "N UW Y EH N"}],
    ),
]
Markup = Annotated[
    Literal["auto", "text", "ssml"], Field(description="Whether the text is SSML; auto: if it begins with <speak.")
]
Strict = Annotated[bool, Field(description="Refuse words whose pronunciation would have to be guessed.")]


class Request(BaseModel):
    """What all requests and messages have in common."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Phase(Request):
    """Where the page's idle clip is, so that the live picture takes over without a jump."""

    frame: float = Field(ge=0, le=1e6, allow_inf_nan=False, description="Frame of the loop, with its fraction.")
    at_ms: float = Field(
        ge=0, le=1e14, allow_inf_nan=False, description="When it was shown: Unix time in ms, server clock."
    )


class StreamRequest(Request):
    """A new stream; with `text` it speaks, without it idles."""

    text: Text | None = None
    avatar: Name | None = None
    trajectory: Trajectory | None = None
    renderer: Renderer | None = None
    voice: Name | None = None
    speed: Speed = 1.0
    lexicon: Lexicon = {}
    strict: Strict = False
    markup: Markup = "auto"
    start: Literal["viewer", "now"] = Field(
        default="viewer", description="viewer: speech waits for the first viewer, so that no word is lost."
    )
    idle: Literal["stream", "local"] = Field(
        default="stream", description="local: no picture is sent while idle, the page shows its own clip."
    )
    once: bool = Field(default=False, description="The stream ends by itself when everything is said.")
    phase: Phase | None = None
    transport: Literal["rtmp"] | None = Field(
        default=None, description="rtmp: push the stream to the service's RTMP server; urls.rtmp is where it plays."
    )
    rtmp_url: Url | None = Field(default=None, description="Push the stream to this RTMP server: rtmp://host/app/key")
    whip_url: Url | None = Field(default=None, description="Push the stream to this WHIP server: https://host/whip")
    whip_token: Token | None = None


class PushRequest(Request):
    """A server to push a stream to."""

    url: Url = Field(description="rtmp://host/app/key, or https://host/whip for WHIP.")
    token: Token | None = None


class SayRequest(Request):
    """More to say on a stream that is there."""

    text: Text
    interrupt: bool = Field(default=False, description="Cut short what is being said and forget what is queued.")
    trajectory: Trajectory | None = None
    renderer: Renderer | None = None
    voice: Name | None = None
    speed: Speed = 1.0
    lexicon: Lexicon = {}
    strict: Strict = False
    markup: Markup = "auto"
    phase: Phase | None = None


class ShownRequest(Request):
    """The browser's own measurement."""

    milliseconds: float = Field(
        ge=0, le=600_000, allow_inf_nan=False, description="From Enter to the first live frame shown."
    )


class RenderRequest(Request):
    """A text to make a file of."""

    text: Text
    avatar: Name | None = None
    trajectory: Trajectory | None = None
    renderer: Renderer | None = None
    voice: Name | None = None
    speed: Speed = 1.0
    lexicon: Lexicon = {}
    strict: Strict = False
    markup: Markup = "auto"


class _Form(BaseModel):
    """Fields of multipart/form-data; they come as strings."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class RecordingRequest(_Form):
    """A recording to speak with."""

    audio: UploadFile = Field(description="WAV of any kind, FLAC, MP3, Ogg or M4A; 8 to 96 kHz; mixed to mono.")
    text: Text = Field(default="", description="What is said in it, all of it; without it the phones are recognised.")
    lexicon: Json[Lexicon] = Field(default={}, description="As with say, as JSON.")
    strict: bool = Field(default=False, description="Refuse a text that is probably not what is said.")
    interrupt: bool = Field(default=False, description="Cut short what is being said and forget what is queued.")
    trajectory: Trajectory | None = None
    renderer: Renderer | None = None


class RenderRecordingRequest(_Form):
    """A recording to make a file of."""

    audio: UploadFile
    text: Text = ""
    lexicon: Json[Lexicon] = {}
    strict: bool = False
    avatar: Name | None = None
    trajectory: Trajectory | None = None
    renderer: Renderer | None = None


class Problem(BaseModel):
    """Any error (RFC 9457)."""

    type: str
    title: str
    status: int
    detail: str
    field: str | None = None
    advice: str | None = None


class Said(BaseModel):
    """An utterance that was taken.

    Attributes:
        unread: pieces of the text that will be left out, since they cannot be read aloud.
        guessed: words whose pronunciation no dictionary has.
    """

    id: str
    unread: list[str]
    guessed: list[str]


class Urls(BaseModel):
    """Where a stream is, as absolute paths; `rtmp` is a whole URL, if it is pushed to the service's own server."""

    self: str
    whep: str
    flv: str
    mp4: str
    video: str
    captions: str
    events: str
    ws: str
    rtmp: str | None = Field(default=None, exclude_if=lambda url: url is None)


class IdleClip(BaseModel):
    """The loop that a page shows while nothing is said."""

    url: str
    fps: float
    frames: int
    width: int
    height: int


class PushEntry(BaseModel):
    """A push to a server: `target` is its URL without credentials, `error` the last one that still matters."""

    id: str
    kind: Literal["rtmp", "whip"]
    target: str
    state: Literal["connecting", "live", "retrying", "failed", "ended"]
    error: str | None
    retries: int


class StreamCreated(BaseModel):
    """A new stream and everything needed to watch it."""

    id: str
    state: str
    avatar: str
    trajectory: str
    renderer: str
    voice: str
    urls: Urls
    pushes: list[PushEntry]
    utterance: Said | None
    idle: IdleClip
    server_time_ms: float


class SayAccepted(BaseModel):
    """Queued, or about to be spoken."""

    utterance: Said
    server_time_ms: float


class Recorded(Said):
    """A recording that was taken.

    Attributes:
        confidence: 0 to 1, how well the text fits; null without a text.
        doubtful: the text is probably not what is said.
    """

    confidence: float | None
    doubtful: bool


class RecordingAccepted(BaseModel):
    """Queued, or about to be spoken."""

    utterance: Recorded
    server_time_ms: float


class Viewers(BaseModel):
    """How many watch, by transport; `rtmp` and `whip` are servers to which the stream is pushed."""

    whep: int
    flv: int
    mp4: int
    rtmp: int
    whip: int


class MediaTimes(BaseModel):
    """Seconds on the stream's clock; 0 is its first frame."""

    start: float
    end: float | None


class UtteranceReport(BaseModel):
    """One utterance: `timings` are milliseconds after its request was received, by stage."""

    id: str
    state: Literal["queued", "speaking", "done", "interrupted", "failed"]
    characters: int
    unread: list[str]
    guessed: list[str]
    media: MediaTimes | None
    timings: dict[str, float]
    error: str | None = None


class Frames(BaseModel):
    """Live frames so far."""

    rendered: int
    dropped: int


class StreamReport(BaseModel):
    """Everything about a stream."""

    id: str
    state: Literal["waiting", "idle", "speaking", "ended"]
    idle: Literal["stream", "local"]
    avatar: str
    trajectory: str
    renderer: str
    voice: str
    viewers: Viewers
    pushes: list[PushEntry]
    utterances: list[UtteranceReport]
    frames: Frames
    server_time_ms: float


class AvatarEntry(BaseModel):
    """An avatar that can be used."""

    id: str
    title: str
    voice: str
    fps: float
    width: int
    height: int
    idle: str
    preview: str
    trajectories: list[str]
    renderers: list[str]


class Avatars(BaseModel):
    """All avatars."""

    default: str
    avatars: list[AvatarEntry]


class VoiceEntry(BaseModel):
    """A voice; `missing` names what must be installed before it can be used."""

    id: str
    name: str
    language: str
    sex: str
    rate: int
    licence: str
    engine: str
    installed: bool
    missing: str


class EngineEntry(BaseModel):
    """A speech engine; `missing` says why it cannot speak here, and what to do about it."""

    name: str
    missing: str


class Voices(BaseModel):
    """Voices; `engine` is the speech engine in use, `engines` are all there are, if all were asked for."""

    default: str
    engine: str
    voices: list[VoiceEntry]
    engines: list[EngineEntry] | None = Field(default=None, exclude_if=lambda engines: engines is None)


class StagePercentiles(BaseModel):
    """Milliseconds over the last `n` utterances."""

    p50: float
    p95: float
    p99: float
    n: int


class SpeechCounts(BaseModel):
    """Sentences of one speech engine: where their phone times came from, and how often they came from memory.

    Attributes:
        native, aligned: with the engine's own times, with an aligner's.
        unsound: whose own times were refused.
        unaligned: that no aligner could align.
        checked, disagreed: compared with an aligner's times; more than a picture away in the median.
        remembered: that had been spoken before.
        fallback: spoken since another engine had failed.
    """

    engine: str
    native: int
    aligned: int
    unsound: int
    unaligned: int
    checked: int
    disagreed: int
    remembered: int
    fallback: int


class LatencyEntry(BaseModel):
    """One of the last utterances: its length and times, never its text nor its stream's key."""

    utterance: str
    characters: int
    timings: dict[str, float]


class Latency(BaseModel):
    """How long every stage takes, over all streams."""

    stages: dict[str, StagePercentiles]
    speech: list[SpeechCounts]
    utterances: list[LatencyEntry]
