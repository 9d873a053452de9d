"""The publishing process by itself: how it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import av
import pytest
from patterns import Studio
from rtmp_server import RtmpServer

from app.stream.container import header
from app.stream.push.pipe import PublishOrder, pack_packet

PATIENCE = 20


@pytest.fixture
def studio() -> Studio:
    return Studio()


@pytest.fixture
def process() -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "app.stream.push.process"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    with process:
        yield process
        process.kill()


def order(studio: Studio, url: str, stall_seconds: float = 10.0) -> bytes:
    head, _ = header("mp4", {"movflags": "empty_moov"}, [studio.video.template, studio.aac.template])
    return PublishOrder("rtmp", url, "", head, studio.video.extradata, stall_seconds).pack()


def give(process: subprocess.Popen[bytes], data: bytes) -> None:
    assert process.stdin is not None
    process.stdin.write(data)
    process.stdin.flush()


def answer(process: subprocess.Popen[bytes]) -> Any:
    assert process.stdout is not None
    return json.loads(process.stdout.readline())


def test_it_ends_with_its_input(process: subprocess.Popen[bytes]) -> None:
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 0


def test_it_publishes_until_its_input_ends(
    process: subprocess.Popen[bytes], studio: Studio, rtmp_server: RtmpServer
) -> None:
    rtmp_server.start()
    give(process, order(studio, rtmp_server.url("key", "kept")))
    assert answer(process) == {"live": True}
    process.send_signal(signal.SIGINT)  # Ctrl-C reaches it too, and is not for it
    packets = [packet for packet in studio.frames(20) if packet.kind != "opus"]
    late = [packet for packet in packets if packet.seconds >= 0.2]  # without a key frame to begin with
    rest = [packet for packet in studio.frames(30) if packet.kind != "opus"]
    give(process, b"".join(map(pack_packet, late[:3] + packets[:1] + late + rest)))
    out, _ = process.communicate(timeout=PATIENCE)
    assert (out, process.returncode) == (b"", 0)
    with av.open(str(rtmp_server.kept("key"))) as kept:
        sizes = [packet.size for packet in kept.demux(video=0) if packet.size]
        assert kept.streams.video[0].codec_context.width == 128
        assert kept.streams.audio[0].codec_context.sample_rate == 48_000
    assert len(sizes) == 1 + 15 + 30


def test_without_a_server_it_says_so_and_ends(process: subprocess.Popen[bytes], studio: Studio) -> None:
    give(process, order(studio, "rtmp://127.0.0.1:1/live/key"))
    assert answer(process) == {
        "error": "the server cannot be reached: Connection refused",
        "refused": False,
        "detail": "",
    }
    assert process.wait(PATIENCE) == 0


def test_a_server_that_does_not_answer_is_the_end_of_it(
    process: subprocess.Popen[bytes], studio: Studio, rtmp_server: RtmpServer
) -> None:
    rtmp_server.start()
    rtmp_server.pause()
    give(process, order(studio, rtmp_server.url("key"), stall_seconds=0.3))
    assert process.wait(PATIENCE) == -signal.SIGALRM  # though nobody kills it


def test_it_outlives_nobody(studio: Studio, rtmp_server: RtmpServer) -> None:
    rtmp_server.start()
    reader, writer = os.pipe()
    with subprocess.Popen(
        [sys.executable, "-m", "app.stream.push.process"], stdin=reader, stdout=subprocess.PIPE
    ) as process:
        os.close(reader)
        os.write(writer, order(studio, rtmp_server.url("key")))
        assert answer(process) == {"live": True}
        os.close(writer)  # as when whoever started it is killed
        assert process.wait(PATIENCE) == 0
