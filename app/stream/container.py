"""What the live container formats have in common: chunks, and headers written by FFmpeg.

FFmpeg writes the headers (codec configuration, metadata, `moov`). The media that follows is written here: FFmpeg's
interleaver holds every picture back until a later packet has come, and its FLV muxer gives up on sound whose time
stamps begin before those of the pictures already sent, as they do with a coder's priming.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal, Protocol, get_args

import av

from app.stream.packet import Packet


@dataclass(frozen=True, slots=True)
class Chunk:
    """A piece of a container format, the same bytes for every viewer.

    Attributes:
        kind: "header" comes first for every viewer; "media" follows.
        data: whole FLV tags or MP4 boxes.
        seconds: time on the stream's clock of the latest packet in it.
        starts: it begins with a key frame.
    """

    kind: Literal["header", "media"]
    data: bytes
    seconds: float
    starts: bool


Format = Literal["flv", "mp4"]
"""The containers a viewer can choose from; MP4 is fragmented."""

FORMATS: tuple[Format, ...] = get_args(Format)


class Container(Protocol):
    """A container format being written: packets in (live H.264 and AAC, key frame first), chunks out."""

    header: Chunk

    def write(self, packet: Packet) -> list[Chunk]:
        """Chunks that are complete now that `packet` is there."""

    def flush(self) -> list[Chunk]:
        """What is waiting for more packets."""


class _Sink(io.RawIOBase):
    """Collects what a muxer writes."""

    def __init__(self) -> None:
        super().__init__()
        self.parts: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self.parts.append(bytes(data))
        return len(data)


def header(name: str, options: dict[str, str], templates: list[Any]) -> tuple[bytes, list[Fraction]]:
    """FFmpeg's header for tracks like `templates`, and the time base it chose for each.

    Args:
        name: FFmpeg's name of the format.
        options: of the muxer.
        templates: of the encoders (`VideoEncoder.template`), in the order of the tracks.
    """
    sink = _Sink()
    output: Any = av.open(sink, "w", format=name, options=options)
    tracks = [output.add_stream_from_template(template) for template in templates]
    output.start_encoding()
    written = b"".join(sink.parts)
    time_bases = [Fraction(track.time_base) for track in tracks]
    output.close()  # writes an end that nobody gets
    return written, time_bases
