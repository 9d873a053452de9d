"""What goes through the pipe to a publishing process: an order, then packets; and what comes back: lines of JSON.

The other ends are `app.stream.push.push` and `app.stream.push.process`.
"""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from typing import Any, BinaryIO

from app.stream.packet import Kind, Packet

_SIZE = struct.Struct(">I")
_PACKET = struct.Struct(">BBqqIIII")  # kind, key frame, pts, dts, duration, time base (two), size of the data
_KINDS: tuple[Kind, ...] = ("video", "opus", "aac")
_BYTES = ("head", "extradata")


@dataclass(frozen=True, slots=True)
class PublishOrder:
    """What a publishing process is to do.

    Attributes:
        kind: "rtmp" or "whip".
        url, token: of the target (`app.stream.push.target`); not for anybody's eyes.
        head: of an MP4 with the two tracks, picture first: their parameters, for RTMP.
        extradata: SPS and PPS in Annex B form, for RTMP.
        stall_seconds: a server that lets the process wait for so long has stalled.
    """

    kind: str
    url: str = field(repr=False)
    token: str = field(repr=False)
    head: bytes
    extradata: bytes
    stall_seconds: float

    def pack(self) -> bytes:
        """Through a pipe and not as arguments, which everybody on the machine can read."""
        values: dict[str, Any] = asdict(self)
        for name in _BYTES:
            values[name] = base64.b64encode(values[name]).decode()
        body = json.dumps(values).encode()
        return _SIZE.pack(len(body)) + body


def read_order(source: BinaryIO) -> PublishOrder | None:
    """The order; None at the end of the input."""
    (size,) = _SIZE.unpack(source.read(_SIZE.size).ljust(_SIZE.size, b"\0"))
    body = source.read(size)
    if not body or len(body) < size:
        return None
    values = json.loads(body)
    for name in _BYTES:
        values[name] = base64.b64decode(values[name])
    return PublishOrder(**values)


def pack_packet(packet: Packet) -> bytes:
    """A packet as bytes."""
    base = packet.time_base
    head = _PACKET.pack(
        _KINDS.index(packet.kind),
        packet.keyframe,
        packet.pts,
        packet.dts,
        packet.duration,
        base.numerator,
        base.denominator,
        len(packet.data),
    )
    return head + packet.data


def read_packet(source: BinaryIO) -> Packet | None:
    """The next packet; None at the end of the input, in the middle of a packet too."""
    head = source.read(_PACKET.size)
    if len(head) < _PACKET.size:
        return None
    kind, keyframe, pts, dts, duration, numerator, denominator, size = _PACKET.unpack(head)
    data = source.read(size)
    if len(data) < size:
        return None
    return Packet(_KINDS[kind], data, pts, dts, duration, Fraction(numerator, denominator), bool(keyframe))
