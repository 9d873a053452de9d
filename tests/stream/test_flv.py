from __future__ import annotations

import io
import json
import struct
import subprocess
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import pytest
from hypothesis import given
from hypothesis import strategies as st
from patterns import FPS, HEIGHT, WIDTH, Studio, read_index

from app.stream.container import Chunk
from app.stream.flv import FlvFormat
from app.stream.packet import Packet


def written(studio: Studio, packets: list[Packet]) -> tuple[Chunk, list[Chunk]]:
    flv = FlvFormat(studio.video, studio.aac)
    chunks = [chunk for packet in packets if packet.kind != "opus" for chunk in flv.write(packet)]
    return flv.header, chunks + flv.flush()


def tags(data: bytes) -> list[tuple[int, int, bytes]]:
    """Kind, milliseconds and body of every tag, by the letter of the specification."""
    found = []
    while data:
        kind, size = data[0], int.from_bytes(data[1:4], "big")
        time = int.from_bytes(data[7:8] + data[4:7], "big")
        assert data[8:11] == bytes(3)
        assert int.from_bytes(data[11 + size : 15 + size], "big") == 11 + size
        found.append((kind, time, data[11 : 11 + size]))
        data = data[15 + size :]
    return found


def indices(data: bytes) -> list[int]:
    with av.open(io.BytesIO(data), format="flv") as container:
        return [read_index(frame.to_ndarray(format="gray")) for frame in container.decode(video=0)]


def test_a_player_reads_it(tmp_path: Path) -> None:
    studio = Studio(keyframe_seconds=0.4)
    header, chunks = written(studio, studio.frames(50))
    path = tmp_path / "live.flv"
    path.write_bytes(header.data + b"".join(chunk.data for chunk in chunks))
    command = ["ffprobe", "-v", "error", "-show_streams", "-show_packets", "-of", "json", str(path)]
    probe = subprocess.run(command, capture_output=True, text=True, check=True)
    assert probe.stderr == ""
    report: Any = json.loads(probe.stdout)
    video, audio = report["streams"]
    assert (video["codec_name"], video["width"], video["height"]) == ("h264", WIDTH, HEIGHT)
    assert video["r_frame_rate"] == f"{FPS}/1"
    assert (audio["codec_name"], audio["sample_rate"], audio["channels"]) == ("aac", "48000", 1)
    times = [float(packet["pts_time"]) for packet in report["packets"] if packet["codec_type"] == "video"]
    assert times == [n / 25 for n in range(50)]
    sound = [float(packet["pts_time"]) for packet in report["packets"] if packet["codec_type"] == "audio"]
    assert sound == pytest.approx([n * 1024 / 48_000 for n in range(len(sound))], abs=0.001)
    assert indices(path.read_bytes()) == list(range(50))


def amf(data: bytes) -> tuple[Any, bytes]:
    """The first AMF 0 value and what follows it: numbers, booleans, strings and the list of names of onMetaData."""
    kind, data = data[0], data[1:]
    if kind == 0:
        return struct.unpack(">d", data[:8])[0], data[8:]
    if kind == 1:
        return bool(data[0]), data[1:]
    if kind == 2:
        size = int.from_bytes(data[:2], "big")
        return data[2 : 2 + size].decode(), data[2 + size :]
    assert kind == 8
    announced, data = int.from_bytes(data[:4], "big"), data[4:]
    found: dict[str, Any] = {}
    while data[:3] != b"\0\0\x09":
        name, data = amf(b"\2" + data)
        found[name], data = amf(data)
    assert len(found) == announced
    return found, data[3:]


def test_metadata_say_what_follows() -> None:
    studio = Studio()
    header, _ = written(studio, [])
    assert header.data[:13] == b"FLV\x01\x05\0\0\0\x09\0\0\0\0"  # sound and pictures
    ((kind, time, script), *sequence_headers) = tags(header.data[13:])
    assert (kind, time) == (18, 0)
    name, rest = amf(script)
    metadata, rest = amf(rest)
    assert (name, rest) == ("onMetaData", b"")
    encoder = metadata.pop("encoder")
    assert encoder.startswith("Lavf")
    # No duration and no file size: players would take zeros for the length of a file.
    assert metadata == {
        "width": WIDTH,
        "height": HEIGHT,
        "framerate": FPS,
        "videocodecid": 7,  # AVC
        "videodatarate": 0,  # not constant
        "audiocodecid": 10,  # AAC
        "audiosamplerate": 48_000,
        "audiosamplesize": 16,
        "stereo": False,
        "audiodatarate": pytest.approx(96_000 / 1024),
    }
    assert [(kind, body[1]) for kind, _, body in sequence_headers] == [(9, 0), (8, 0)]


def test_every_packet_is_a_chunk_at_once() -> None:
    studio = Studio()
    flv = FlvFormat(studio.video, studio.aac)
    for packet in studio.frames(20):
        if packet.kind == "opus" or packet.pts < 0:
            continue
        (chunk,) = flv.write(packet)
        assert chunk.seconds == packet.seconds
        assert chunk.starts == packet.starts
        ((kind, _, _),) = tags(chunk.data)
        assert kind == (9 if packet.kind == "video" else 8)


def test_a_late_viewer_decodes_the_first_picture() -> None:
    studio = Studio(keyframe_seconds=0.4)
    header, chunks = written(studio, studio.frames(40))
    start = [place for place, chunk in enumerate(chunks) if chunk.starts][-1]
    assert indices(header.data + b"".join(chunk.data for chunk in chunks[start:])) == list(range(30, 40))


def test_priming_from_before_the_clock_is_left_out() -> None:
    studio = Studio()
    packets = studio.frames(10)
    assert any(packet.kind == "aac" and packet.pts < 0 for packet in packets)
    _, chunks = written(studio, packets)
    assert min(time for chunk in chunks for _, time, _ in tags(chunk.data)) == 0


@given(st.integers(0, 1 << 31), st.binary(max_size=300), st.booleans())
def test_any_sound_comes_back(milliseconds: int, data: bytes, key: bool) -> None:
    packet = Packet("aac", data, milliseconds, milliseconds, 21, Fraction(1, 1000), keyframe=key)
    (chunk,) = FORMAT.write(packet)
    assert tags(chunk.data) == [(8, milliseconds, b"\xaf\x01" + data)]


FORMAT = FlvFormat(Studio().video, Studio().aac)
