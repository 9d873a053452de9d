"""Fragmented MP4 for Media Source Extensions: a `moof` and an `mdat` every 100 ms (ISO/IEC 14496-12, 8.8)."""

from __future__ import annotations

import struct
from fractions import Fraction

from app.stream.container import Chunk, header
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.nal import length_prefixed
from app.stream.packet import Packet

FRAGMENT_SECONDS = Fraction(1, 10)

_VIDEO_TRACK, _AUDIO_TRACK = 1, 2
_SYNC_SAMPLE = 0x02000000  # depends on no other
_OTHER_SAMPLE = 0x01010000  # depends on others, is no sync sample
_BASE_IS_MOOF = 0x020000  # tfhd
_TRUN_FIELDS = 0x000001 | 0x000100 | 0x000200 | 0x000400 | 0x000800  # data offset; duration, size, flags, time offset


class Mp4Format:
    """Live MP4 with H.264 and AAC. Decode times are those of the stream's clock, for late viewers too.

    A fragment is handed on as soon as it holds 100 ms of either track, or before a key frame, which always begins one.
    """

    def __init__(self, video: VideoEncoder, audio: AacEncoder) -> None:
        options = {"movflags": "empty_moov+default_base_moof+skip_trailer"}
        data, (video_base, audio_base) = header("mp4", options, [video.template, audio.template])
        self.header = Chunk("header", data, 0.0, starts=False)
        self._time_bases = {"video": video_base, "aac": audio_base}
        self._sequence = 0
        self._video: list[Packet] = []
        self._audio: list[Packet] = []

    def write(self, packet: Packet) -> list[Chunk]:
        """The fragments complete with `packet`. Sound from before the clock began (the coder's priming) is left out."""
        if packet.pts < 0 or packet.dts < 0:
            return []
        chunks = self.flush() if packet.starts else []
        track = self._video if packet.kind == "video" else self._audio
        track.append(packet)
        if sum(each.duration for each in track) * packet.time_base >= FRAGMENT_SECONDS:
            chunks += self.flush()
        return chunks

    def flush(self) -> list[Chunk]:
        """The fragment begun, if there is one."""
        packets = [*self._video, *self._audio]
        if not packets:
            return []
        self._sequence += 1
        video = [(packet, length_prefixed(packet.data)) for packet in self._video]
        audio = [(packet, packet.data) for packet in self._audio]
        # The data offsets are counted from the start of the moof, whose size does not depend on them.
        size = len(self._movie_fragment(video, audio, 0))
        media = _box(b"mdat", *(data for _, data in [*video, *audio]))
        fragment = self._movie_fragment(video, audio, size + 8) + media
        starts = bool(self._video) and self._video[0].keyframe
        self._video, self._audio = [], []
        return [Chunk("media", fragment, max(packet.seconds for packet in packets), starts)]

    def _movie_fragment(
        self, video: list[tuple[Packet, bytes]], audio: list[tuple[Packet, bytes]], offset: int
    ) -> bytes:
        tracks = []
        if video:
            tracks.append(self._track_fragment(_VIDEO_TRACK, video, offset))
            offset += sum(len(data) for _, data in video)
        if audio:
            tracks.append(self._track_fragment(_AUDIO_TRACK, audio, offset))
        return _box(b"moof", _full_box(b"mfhd", 0, 0, struct.pack(">I", self._sequence)), *tracks)

    def _track_fragment(self, track: int, samples: list[tuple[Packet, bytes]], offset: int) -> bytes:
        first = samples[0][0]
        scale = first.time_base / self._time_bases[first.kind]
        times = [round(packet.dts * scale) for packet, _ in samples]
        end = samples[-1][0]
        times.append(round((end.dts + end.duration) * scale))
        entries = b"".join(
            struct.pack(
                ">IIIi",
                times[place + 1] - times[place],
                len(data),
                _SYNC_SAMPLE if packet.keyframe else _OTHER_SAMPLE,
                round((packet.pts - packet.dts) * scale),
            )
            for place, (packet, data) in enumerate(samples)
        )
        return _box(
            b"traf",
            _full_box(b"tfhd", 0, _BASE_IS_MOOF, struct.pack(">I", track)),
            _full_box(b"tfdt", 1, 0, struct.pack(">Q", times[0])),
            _full_box(b"trun", 1, _TRUN_FIELDS, struct.pack(">Ii", len(samples), offset), entries),
        )


def _box(name: bytes, *parts: bytes) -> bytes:
    size = 8 + sum(len(part) for part in parts)
    return b"".join((struct.pack(">I", size), name, *parts))


def _full_box(name: bytes, version: int, flags: int, *parts: bytes) -> bytes:
    return _box(name, struct.pack(">I", version << 24 | flags), *parts)
