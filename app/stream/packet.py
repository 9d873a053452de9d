"""One encoded picture or piece of sound, as it is shared between all viewers and formats."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal

import av

Kind = Literal["video", "opus", "aac"]


@dataclass(frozen=True, slots=True)
class Packet:
    """Encoded once, sent many times: the bytes are never copied per viewer and never changed.

    Attributes:
        kind: which track it belongs to.
        data: H.264 in Annex B form (key frames carry SPS and PPS), a raw Opus packet, or a raw AAC frame (no ADTS).
        pts: presentation time in `time_base` on the stream's clock; 0 = the first frame ever sent. Sound may be
            negative by the coder's priming.
        dts: decoding time in `time_base`; equal to `pts` in live video.
        duration: in `time_base`.
        time_base: seconds per unit.
        keyframe: video: decoding can start here; sound: always true.
        idle: video: nobody speaks in it; a page that shows a clip of its own meanwhile can do without.
    """

    kind: Kind
    data: bytes
    pts: int
    dts: int
    duration: int
    time_base: Fraction
    keyframe: bool
    idle: bool = False

    @property
    def seconds(self) -> float:
        """Presentation time in seconds on the stream's clock."""
        return self.pts * self.time_base.numerator / self.time_base.denominator

    @property
    def starts(self) -> bool:
        """A viewer can start here (see `app.stream.broadcast.Item`)."""
        return self.kind == "video" and self.keyframe

    def to_av(self) -> Any:
        """A new PyAV packet with a copy of the data; muxers and RTP senders change what they are given."""
        packet: Any = av.Packet(self.data)
        packet.pts = self.pts
        packet.dts = self.dts
        packet.duration = self.duration
        packet.time_base = self.time_base
        packet.is_keyframe = self.keyframe
        return packet
