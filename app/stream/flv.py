"""FLV over HTTP: one tag a packet, handed on at once (Adobe Flash Video File Format Specification 10.1, annex E.4)."""

from __future__ import annotations

from app.stream.container import Chunk, header
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.nal import length_prefixed
from app.stream.packet import Packet

_AUDIO_TAG, _VIDEO_TAG = 8, 9
_AAC = 0xAF  # the specification fixes rate and channels in this byte; the real ones are in the AAC header
_AVC_KEYFRAME, _AVC_INTER = 0x17, 0x27
_MEDIA = 1  # as opposed to a sequence header


class FlvFormat:
    """Live FLV with H.264 and AAC. Time stamps are milliseconds on the stream's clock, for late viewers too."""

    def __init__(self, video: VideoEncoder, audio: AacEncoder) -> None:
        options = {"flvflags": "no_duration_filesize+no_sequence_end"}
        data, _ = header("flv", options, [video.template, audio.template])
        self.header = Chunk("header", data, 0.0, starts=False)

    def write(self, packet: Packet) -> list[Chunk]:
        """The tag of `packet`. Sound from before the stream's clock began (the coder's priming) has no place in FLV."""
        if packet.pts < 0 or packet.dts < 0:
            return []
        if packet.kind == "video":
            offset = _milliseconds(packet, packet.pts) - _milliseconds(packet, packet.dts)
            frame = _AVC_KEYFRAME if packet.keyframe else _AVC_INTER
            body = bytes([frame, _MEDIA]) + offset.to_bytes(3, "big", signed=True) + length_prefixed(packet.data)
            data = _tag(_VIDEO_TAG, _milliseconds(packet, packet.dts), body)
        else:
            data = _tag(_AUDIO_TAG, _milliseconds(packet, packet.pts), bytes([_AAC, _MEDIA]) + packet.data)
        return [Chunk("media", data, packet.seconds, packet.starts)]

    def flush(self) -> list[Chunk]:
        """Nothing ever waits."""
        return []


def _milliseconds(packet: Packet, time: int) -> int:
    return round(time * 1000 * packet.time_base)


def _tag(kind: int, milliseconds: int, body: bytes) -> bytes:
    time = milliseconds & 0xFFFFFFFF
    head = bytes([kind]) + len(body).to_bytes(3, "big") + (time & 0xFFFFFF).to_bytes(3, "big") + bytes([time >> 24])
    stream = bytes(3)
    return head + stream + body + (len(head) + len(stream) + len(body)).to_bytes(4, "big")
