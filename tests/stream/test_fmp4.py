from __future__ import annotations

import io
import json
import struct
import subprocess
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import pytest
from patterns import FPS, HEIGHT, WIDTH, Studio, read_index

from app.stream.container import Chunk
from app.stream.fmp4 import FRAGMENT_SECONDS, Mp4Format
from app.stream.packet import Packet


def written(studio: Studio, packets: list[Packet]) -> tuple[Chunk, list[Chunk]]:
    mp4 = Mp4Format(studio.video, studio.aac)
    chunks = [chunk for packet in packets if packet.kind != "opus" for chunk in mp4.write(packet)]
    return mp4.header, chunks + mp4.flush()


def boxes(data: bytes) -> Iterator[tuple[str, bytes]]:
    while data:
        (size,) = struct.unpack(">I", data[:4])
        assert 8 <= size <= len(data)
        yield data[4:8].decode(), data[8:size]
        data = data[size:]


def decode_times(chunk: Chunk) -> dict[int, int]:
    """Base media decode time of each track in a fragment."""
    (_, moof), _ = boxes(chunk.data)
    times = {}
    for name, content in boxes(moof):
        if name == "traf":
            parts = dict(boxes(content))
            times[struct.unpack(">I", parts["tfhd"][4:8])[0]] = struct.unpack(">Q", parts["tfdt"][4:12])[0]
    return times


def indices(data: bytes) -> list[int]:
    with av.open(io.BytesIO(data), format="mp4") as container:
        return [read_index(frame.to_ndarray(format="gray")) for frame in container.decode(video=0)]


def test_a_player_reads_it(tmp_path: Path) -> None:
    studio = Studio(keyframe_seconds=0.4)
    header, chunks = written(studio, studio.frames(50))
    path = tmp_path / "live.mp4"
    path.write_bytes(header.data + b"".join(chunk.data for chunk in chunks))
    command = ["ffprobe", "-v", "error", "-show_streams", "-show_packets", "-of", "json", str(path)]
    probe = subprocess.run(command, capture_output=True, text=True, check=True)
    assert probe.stderr == ""
    report: Any = json.loads(probe.stdout)
    video, audio = report["streams"]
    assert (video["codec_name"], video["width"], video["height"]) == ("h264", WIDTH, HEIGHT)
    assert video["color_space"] == video["color_primaries"] == video["color_transfer"] == "bt709"
    assert video["color_range"] == "tv"
    assert video["avg_frame_rate"] == f"{FPS}/1"
    assert (audio["codec_name"], audio["sample_rate"], audio["channels"]) == ("aac", "48000", 1)
    times = [float(packet["pts_time"]) for packet in report["packets"] if packet["codec_type"] == "video"]
    assert times == pytest.approx([n / 25 for n in range(50)])
    sound = [float(packet["pts_time"]) for packet in report["packets"] if packet["codec_type"] == "audio"]
    assert sound == pytest.approx([n * 1024 / 48_000 for n in range(len(sound))], abs=1e-5)
    keys = [
        float(packet["pts_time"])
        for packet in report["packets"]
        if packet["codec_type"] == "video" and "K" in packet["flags"]
    ]
    assert keys == pytest.approx([0, 0.4, 0.8, 1.2, 1.6])
    assert indices(path.read_bytes()) == list(range(50))


def test_a_late_viewer_decodes_the_first_picture() -> None:
    studio = Studio(keyframe_seconds=0.4)
    header, chunks = written(studio, studio.frames(40))
    start = [place for place, chunk in enumerate(chunks) if chunk.starts][-1]
    assert indices(header.data + b"".join(chunk.data for chunk in chunks[start:])) == list(range(30, 40))


def test_times_are_those_of_the_stream_for_late_muxers_too() -> None:
    studio = Studio(keyframe_seconds=4.0)
    packets = studio.frames(102)
    start = next(place for place, packet in enumerate(packets) if packet.starts and packet.pts > 0)
    _, chunks = written(studio, packets[start:])
    times = decode_times(chunks[0])
    assert times[1] == 4 * 12_800
    assert abs(times[2] / 48_000 - 4.0) < 0.07


def test_fragments_are_short_and_key_frames_begin_them() -> None:
    studio = Studio(keyframe_seconds=0.28)
    _, chunks = written(studio, studio.frames(50))
    starts = [chunk for chunk in chunks if chunk.starts]
    assert [decode_times(chunk)[1] / 12_800 for chunk in starts] == pytest.approx([n * 0.28 for n in range(8)])
    seconds = [chunk.seconds for chunk in chunks]
    assert max(later - earlier for earlier, later in pairwise(seconds)) < 2 * FRAGMENT_SECONDS


def test_sound_goes_on_while_pictures_pause() -> None:
    studio = Studio(keyframe_seconds=10)
    mp4 = Mp4Format(studio.video, studio.aac)
    data, delays = mp4.header.data, []
    waiting: list[float] = []
    for index in range(60):
        for packet in studio.frame(picture_too=not 20 <= index < 45):
            if packet.kind == "opus":
                continue
            waiting.append(packet.seconds)
            for chunk in mp4.write(packet):
                data += chunk.data
                delays.append(packet.seconds - min(waiting))
                waiting = []
    data += b"".join(chunk.data for chunk in mp4.flush())
    assert max(delays) < 0.2
    assert indices(data) == [*range(20), *range(45, 60)]
    with av.open(io.BytesIO(data), format="mp4") as container:
        times = [packet.pts for packet in container.demux(audio=0) if packet.pts is not None]
    assert times == [1024 * n for n in range(len(times))]
