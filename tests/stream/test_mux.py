from __future__ import annotations

import asyncio
import contextlib
import io
import json
import subprocess
from collections.abc import AsyncIterator, Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

import av
import pytest
from patterns import Studio, read_index

from app.stream.broadcast import Broadcast
from app.stream.container import Chunk
from app.stream.encoder import VideoEncoder
from app.stream.flv import FlvFormat
from app.stream.mux import LiveMuxer, Mp4File
from app.stream.packet import Packet

Name = Literal["flv", "mp4"]
FORMATS: list[Name] = ["flv", "mp4"]


class Show:
    """A studio on the air, with a muxer."""

    def __init__(self, name: Name, **options: object) -> None:
        self.studio = Studio(**options)
        self.source: Broadcast[Packet] = Broadcast()
        self.muxer = LiveMuxer(name, self.source, self.studio.video, self.studio.aac, queue_seconds=1.0)

    async def play(self, frames: int) -> None:
        for _ in range(frames):
            for packet in self.studio.frame():
                self.source.publish(packet)
            for _ in range(4):
                await asyncio.sleep(0)


async def everything(stream: AsyncIterator[bytes]) -> bytes:
    return b"".join([data async for data in stream])


def indices(data: bytes, name: str) -> list[int]:
    with av.open(io.BytesIO(data), format=name) as container:
        return [read_index(frame.to_ndarray(format="gray")) for frame in container.decode(video=0)]


@pytest.mark.parametrize("name", FORMATS)
async def test_viewers_share_one_muxer(name: Name) -> None:
    show = Show(name, keyframe_seconds=0.4)
    early = asyncio.create_task(everything(show.muxer.watch()))
    await asyncio.sleep(0)
    await show.play(15)
    late = asyncio.create_task(everything(show.muxer.watch()))
    await asyncio.sleep(0.01)
    assert show.source.subscribers == 1
    await show.play(10)
    show.source.close()
    assert indices(await early, name) == list(range(25))
    seen = indices(await late, name)
    assert seen == list(range(10, 25))


@pytest.mark.parametrize("name", FORMATS)
async def test_nothing_is_muxed_before_the_first_viewer_and_after_the_last(name: Name) -> None:
    show = Show(name, keyframe_seconds=0.4)
    await show.play(15)
    assert show.source.subscribers == 0
    for _ in range(2):
        viewer = show.muxer.watch()
        data = await anext(viewer) + await anext(viewer)
        assert show.source.subscribers == 1
        assert indices(data, name)[0] % 10 == 0  # a key frame
        await viewer.aclose()
        assert show.source.subscribers == 0
        await show.play(15)


@pytest.mark.parametrize("name", FORMATS)
async def test_one_slow_viewer_does_not_hold_up_the_others(name: Name) -> None:
    show = Show(name, keyframe_seconds=0.4)
    quick = asyncio.create_task(everything(show.muxer.watch()))
    slow = show.muxer.watch()
    await anext(slow)
    await show.play(250)
    assert [data async for data in slow] == []  # disconnected
    assert show.source.subscribers == 1
    show.source.close()
    assert indices(await quick, name) == list(range(250))


@pytest.mark.parametrize("name", FORMATS)
async def test_watching_after_the_end_ends_at_once(name: Name) -> None:
    show = Show(name)
    await show.play(3)
    show.source.close()
    await asyncio.wait_for(everything(show.muxer.watch()), 5)


async def test_close_ends_the_viewers() -> None:
    show = Show("flv")
    viewer = asyncio.create_task(everything(show.muxer.watch()))
    await asyncio.sleep(0)
    await show.play(10)
    await show.muxer.close()
    assert indices(await viewer, "flv") == list(range(10))
    assert show.source.subscribers == 0


def test_ffmpeg_reads_it_from_a_pipe() -> None:
    studio = Studio()
    flv = FlvFormat(studio.video, studio.aac)
    data = flv.header.data + b"".join(
        chunk.data for packet in studio.frames(50) if packet.kind != "opus" for chunk in flv.write(packet)
    )
    command = ["ffmpeg", "-v", "error", "-f", "flv", "-i", "pipe:0", "-f", "null", "-"]
    run = subprocess.run(command, input=data, capture_output=True, check=True)
    assert run.stderr == b""


def write(path: Path, packets: Iterable[Packet], studio: Studio, *, sound: bool = True) -> None:
    with Mp4File(path, studio.video, studio.aac if sound else None) as file:
        for packet in packets:
            file.add(packet)


def probe(path: Path) -> Any:
    command = ["ffprobe", "-v", "error", "-show_streams", "-show_packets", "-of", "json", str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stderr == ""
    return json.loads(run.stdout)


def file_packets(studio: Studio, frames: int) -> Iterator[Packet]:
    for _ in range(frames):
        yield from studio.frame()
    for encoder in (studio.video, studio.aac):
        yield from encoder.flush()


@pytest.mark.parametrize("live", [True, False])
def test_a_finished_file(tmp_path: Path, live: bool) -> None:
    studio = Studio(live=live, preset="fast", crf=16)
    path = tmp_path / "said.mp4"
    write(path, file_packets(studio, 75), studio)
    assert list(tmp_path.iterdir()) == [path]
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")  # starts fast
    assert b"colrnclx" in data
    report = probe(path)
    video, audio = report["streams"]
    assert video["nb_frames"] == "75"
    assert float(video["start_time"]) == 0.0
    assert float(video["duration"]) == pytest.approx(3.0)
    assert float(audio["start_time"]) == pytest.approx(0.0, abs=1e-4)
    assert {video[key] for key in ("color_space", "color_primaries", "color_transfer")} == {"bt709"}
    assert indices(data, "mp4") == list(range(75))


def test_both_tracks_are_moved_by_the_same_time(tmp_path: Path) -> None:
    """A piece of a live stream: key frame at 2 s; the beep at 3 s must sound with picture 75."""
    studio = Studio(keyframe_seconds=2.0)
    packets = list(file_packets(studio, 100))
    first = next(place for place, packet in enumerate(packets) if packet.pts == 40 and packet.kind == "video")
    path = tmp_path / "piece.mp4"
    write(path, packets[first:], studio)
    assert indices(path.read_bytes(), "mp4")[0] == 50
    with av.open(str(path)) as container:
        frames = [(frame.time, frame.to_ndarray().reshape(-1)) for frame in container.decode(audio=0)]
    beep = next(
        time + int((abs(sound) > 0.1).argmax()) / 48_000
        for time, sound in frames
        if (abs(sound) > 0.1).any() and time > 0.5
    )
    assert beep == pytest.approx(1.0, abs=0.005)


def test_sound_may_come_before_the_first_picture(tmp_path: Path) -> None:
    studio = Studio()
    packets = sorted(file_packets(studio, 30), key=lambda packet: packet.kind)  # aac, opus, video
    path = tmp_path / "sorted.mp4"
    write(path, packets, studio)
    streams = probe(path)["streams"]
    assert streams[0]["nb_frames"] == "30"
    assert float(streams[1]["start_time"]) == pytest.approx(0.0, abs=1e-4)


def test_without_sound(tmp_path: Path) -> None:
    studio = Studio()
    path = tmp_path / "silent.mp4"
    write(path, studio.frames(5), studio, sound=False)
    assert [stream["codec_type"] for stream in probe(path)["streams"]] == ["video"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, GeneratorExit])
def test_an_interrupted_file_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    studio = Studio()
    path = tmp_path / "said.mp4"
    path.write_bytes(b"the last one")

    def packets() -> Iterator[Packet]:
        yield from studio.frames(10)
        raise error

    with pytest.raises(error):
        write(path, packets(), studio)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"the last one"


def test_a_discarded_file_leaves_nothing_and_a_finished_one_stays(tmp_path: Path) -> None:
    studio = Studio()
    file = Mp4File(tmp_path / "a.mp4", studio.video, studio.aac)
    packets = studio.frames(5)
    for packet in packets:
        file.add(packet)
    file.discard()
    file.discard()
    file.add(packets[0])
    assert list(tmp_path.iterdir()) == []
    file = Mp4File(tmp_path / "a.mp4", studio.video, studio.aac)
    for packet in packets:
        file.add(packet)
    file.finish()
    file.finish()
    file.discard()
    assert list(tmp_path.iterdir()) == [tmp_path / "a.mp4"]


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    studio = Studio()
    with pytest.raises(FileNotFoundError):
        write(tmp_path / "none" / "a.mp4", [], studio)


def test_files_are_written_beside_their_place(tmp_path: Path) -> None:
    studio = Studio()
    with contextlib.suppress(ZeroDivisionError), Mp4File(tmp_path / "a.mp4", studio.video, studio.aac) as file:
        for packet in studio.frames(5):
            file.add(packet)
        assert not (tmp_path / "a.mp4").exists()
        assert len(list(tmp_path.iterdir())) == 1
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_the_template_serves_many_muxers() -> None:
    encoder = VideoEncoder(128, 128, 25)
    assert encoder.template.codec_context.extradata == encoder.extradata


async def test_a_muxer_that_fails_says_so_and_lets_its_viewers_go(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    show = Show("flv")

    def fail(*_: object) -> list[Chunk]:
        raise ZeroDivisionError

    with monkeypatch.context() as patch:
        patch.setattr(FlvFormat, "write", fail)
        viewer = asyncio.create_task(everything(show.muxer.watch()))
        await asyncio.sleep(0)
        await show.play(1)
        assert (await asyncio.wait_for(viewer, 5))[:3] == b"FLV"
    assert "muxing flv failed" in caplog.text
    assert "ZeroDivisionError" in caplog.text
    again = show.muxer.watch()
    assert (await anext(again))[:3] == b"FLV"
    await again.aclose()
