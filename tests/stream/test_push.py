from __future__ import annotations

import asyncio
import logging
import os
import signal
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from patterns import FPS, HEIGHT, SAMPLE_RATE, WIDTH, Studio, read_index
from puppet import PATIENCE, until
from rtmp_server import TOKEN, RtmpServer
from whip_server import TOKEN as WHIP_TOKEN
from whip_server import WhipServer

from app.config import PushSettings
from app.errors import OverCapacity
from app.stream.broadcast import Broadcast
from app.stream.packet import Packet
from app.stream.push.push import MAX_REFUSALS, Push, PushReport
from app.stream.push.target import push_target
from app.stream.seats import Seats

SETTINGS = PushSettings(stall_seconds=5, retry_seconds=0.1, retry_max_seconds=0.3)


def children() -> set[str]:
    """Processes that the event loop's thread has started."""
    return set(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


def files() -> int:
    """How many are open."""
    return len(list(Path("/proc/self/fd").iterdir()))


def threads() -> set[threading.Thread]:
    """Those that run, but for the executor's."""
    return {thread for thread in threading.enumerate() if not thread.name.startswith("asyncio_")}


class Station:
    """Patterns on the air in real time, and pushes of them."""

    def __init__(self, *, noise: bool = False, keyframe_seconds: float = 0.5) -> None:
        self.studio = Studio(max_kbps=2_000, preset="ultrafast", keyframe_seconds=keyframe_seconds)
        self.broadcast: Broadcast[Packet] = Broadcast()
        self.sent: list[Packet] = []
        self.seats = Seats(2, "pushes")
        self.history: list[PushReport] = []
        self.pushes: list[Push] = []
        random = np.random.default_rng(7)
        # A server that stands still is noticed when its kernel's buffers are full: noise fills them.
        self._noise = random.integers(0, 256, (FPS, HEIGHT * 3 // 2, WIDTH), np.uint8) if noise else None
        self._air = asyncio.create_task(self._run())

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        begin = loop.time()
        while True:
            index = self.studio.index
            packets: list[Packet] = []
            if self._noise is not None:
                packets += self.studio.video.encode(self._noise[index % FPS], index)
            packets += self.studio.frame(picture_too=self._noise is None)
            for packet in packets:
                self.sent.append(packet)
                self.broadcast.publish(packet)
            await asyncio.sleep(max(0.0, begin + self.studio.index / FPS - loop.time()))

    def push(self, url: str, settings: PushSettings = SETTINGS, token: str = "") -> Push:
        target = push_target(url, token=token)
        push = Push(
            target,
            self.broadcast,
            self.studio.video,
            self.studio.aac if target.kind == "rtmp" else self.studio.opus,
            settings,
            self.seats,
            request_keyframe=self.studio.video.request_keyframe,
            on_change=lambda push: self.history.append(push.report()),
        )
        self.pushes.append(push)
        return push

    async def go_off_air(self) -> None:
        self._air.cancel()
        await asyncio.gather(self._air, return_exceptions=True)
        self.broadcast.close()

    async def close(self) -> None:
        await self.go_off_air()
        for push in self.pushes:
            await push.close()


@pytest.fixture
async def station() -> AsyncIterator[Callable[..., Station]]:
    """Makes a station; nothing may be left of it."""
    loop = asyncio.get_running_loop()
    await loop.run_in_executor(None, lambda: None)  # the executor's own pipes and threads are there from now on
    before = children(), files(), threads(), asyncio.all_tasks()
    stations: list[Station] = []

    def make(**options: Any) -> Station:
        stations.append(Station(**options))
        return stations[-1]

    yield make
    for each in stations:
        await each.close()
        assert each.seats.taken == 0
    await until(lambda: children() <= before[0] and files() <= before[1] and threads() <= before[2])
    assert asyncio.all_tasks() <= before[3] | {asyncio.current_task()}


class Played:
    """What a player of the server gets within `seconds` of picture, or up to the end of a file."""

    def __init__(self, url: str, seconds: float = 2.5) -> None:
        self.indices: list[int] = []
        self.times: list[float] = []
        self.keyframes: list[bool] = []
        self.samples = np.zeros(0, np.float32)
        self.sound_start = 0.0
        sound: list[Any] = []
        at_once = {"analyzeduration": "1000000"}  # key frames come every half second
        with av.open(url, options=at_once, timeout=(PATIENCE, PATIENCE)) as player:
            for frame in player.decode():
                if isinstance(frame, av.VideoFrame):
                    self.indices.append(read_index(frame.to_ndarray()[:HEIGHT]))
                    self.times.append(float(frame.time))
                    self.keyframes.append(bool(frame.key_frame))
                    if self.times[-1] - self.times[0] >= seconds:
                        break
                else:
                    self.sound_start = self.sound_start if sound else float(frame.time)
                    sound.append(frame.to_ndarray()[0])
        self.samples = np.concatenate(sound)

    def beeps(self) -> list[float]:
        """When they begin."""
        loud = np.abs(self.samples) > 0.25
        quiet_before = np.convolve(loud, np.ones(2_400), "full")[: len(loud)] - loud == 0
        places = np.flatnonzero(loud & quiet_before)
        return [self.sound_start + place / SAMPLE_RATE for place in places if place > 2_400]

    def check_in_step(self) -> None:
        """Picture n is shown n / 25 s after beep 0 is heard, if both were there from the beginning."""
        zero = np.median(np.array(self.times) - np.array(self.indices) / FPS)
        beeps = self.beeps()
        assert beeps
        for beep in beeps:
            assert abs((beep - zero + 0.5) % 1 - 0.5) < 0.03


async def play(url: str | Path, seconds: float = 2.5) -> Played:
    return await asyncio.to_thread(Played, str(url), seconds)


def is_live(push: Push) -> Callable[[], bool]:
    return lambda: push.state == "live"


async def test_a_stream_can_be_played_at_the_server(station: Any, rtmp_server: RtmpServer) -> None:
    rtmp_server.start()
    air = station()
    await until(lambda: air.studio.index > 30)  # the stream has been running for a while
    push = air.push(rtmp_server.url("key"))
    assert push.state == "connecting"
    await until(is_live(push))
    played = await play(rtmp_server.url("key"))
    assert np.all(np.diff(played.indices) == 1)
    assert played.keyframes[0]
    assert played.times[0] < 15  # the server's time is not the stream's
    played.check_in_step()
    assert push.report() == PushReport(push.id, "rtmp", f"rtmp://{rtmp_server.address}/live/…", "live", "", 0)
    assert air.seats.taken == 1

    await push.close()

    assert push.state == "ended"
    assert [report.state for report in air.history] == ["live", "ended"]
    assert air.seats.taken == 0
    assert "deleteStream" in (rtmp_server.folder / "error.log").read_text()  # it said goodbye


async def test_the_end_of_a_stream_is_played_out(station: Any, rtmp_server: RtmpServer) -> None:
    rtmp_server.start()
    air = station()
    push = air.push(rtmp_server.url("key", "kept"))
    await until(is_live(push))
    await until(lambda: air.studio.index > 40)
    await air.go_off_air()
    await push.close(grace=PATIENCE)
    assert push.state == "ended"
    kept = await play(rtmp_server.kept("key"), 60)
    assert kept.indices[-1] == air.studio.index - 1
    assert np.all(np.diff(kept.indices) == 1)
    zero = kept.times[-1] - kept.indices[-1] / FPS
    last = [packet for packet in air.sent if packet.kind == "aac"][-1]
    heard = kept.sound_start + len(kept.samples) / SAMPLE_RATE - zero
    assert heard == pytest.approx((last.pts + last.duration) / SAMPLE_RATE, abs=0.005)


async def test_a_server_that_is_down_is_tried_again(station: Any, rtmp_server: RtmpServer) -> None:
    air = station()
    push = air.push(rtmp_server.url("key"))
    await until(lambda: push.report().retries >= 2)
    assert push.state == "retrying"
    assert push.report().error == "the server cannot be reached: Connection refused"
    rtmp_server.start()
    await until(is_live(push))
    assert push.report().error == ""
    assert (await play(rtmp_server.url("key"), 0.5)).keyframes[0]


async def test_a_server_that_was_killed_gets_the_stream_from_a_key_frame_on(
    station: Any, rtmp_server: RtmpServer
) -> None:
    rtmp_server.start()
    air = station()
    push = air.push(rtmp_server.url("key"))
    await until(is_live(push))
    rtmp_server.kill()
    await until(lambda: push.state == "retrying")
    assert "connection" in push.report().error.lower()
    rtmp_server.start()
    await until(is_live(push))
    played = await play(rtmp_server.url("key"), 1.2)
    assert played.keyframes[0]
    assert np.all(np.diff(played.indices) == 1)
    played.check_in_step()
    assert [report.state for report in air.history if report.state == "live"] == ["live", "live"]


async def test_a_server_that_stands_still_is_left_and_tried_again(station: Any, rtmp_server: RtmpServer) -> None:
    rtmp_server.start()
    air = station(noise=True)
    push = air.push(rtmp_server.url("key"), SETTINGS.model_copy(update={"stall_seconds": 1.0}))
    await until(is_live(push))
    rtmp_server.pause()
    await until(lambda: push.state == "retrying")
    assert push.report().error == "the server has taken nothing for 1 s"
    await until(lambda: push.report().error == "the server has answered nothing for 1 s")  # nor does it let one in
    rtmp_server.resume()
    await until(is_live(push))


async def test_a_short_stall_is_ridden_out_and_no_viewer_sees_it(station: Any, rtmp_server: RtmpServer) -> None:
    rtmp_server.start()
    air = station(noise=True)
    push = air.push(rtmp_server.url("short", "kept"), SETTINGS.model_copy(update={"stall_seconds": 60.0}))
    await until(is_live(push))
    with air.broadcast.subscribe({"video", "aac"}, backlog=False) as viewer:
        start = await anext(viewer)  # a key frame
        rtmp_server.pause()
        behind = air.studio.index + 2 * FPS  # half a megabyte; a socket and the kernel hold less
        await until(lambda: air.studio.index > behind)
        rtmp_server.resume()
        caught_up = air.studio.index + FPS
        await until(lambda: air.studio.index > caught_up)
        first = next(n for n, packet in enumerate(air.sent) if packet is start) + 1
        wanted = [packet for packet in air.sent[first:] if packet.kind in ("video", "aac")]
        seen = [await anext(viewer) for _ in wanted]
        assert (viewer.cuts, viewer.slow) == (0, False)
    assert seen == wanted
    assert {report.state for report in air.history} == {"live"}
    assert push.report().retries == 0
    await push.close()
    with av.open(str(rtmp_server.kept("short"))) as kept:
        times = [float(packet.pts * packet.time_base) for packet in kept.demux(video=0) if packet.pts is not None]
    assert times[-1] - times[0] > 3 - 0.5
    assert max(np.diff(times)) < 1.5 / FPS  # nothing is missing


async def test_a_server_that_stands_still_does_not_hold_up_the_end(station: Any, rtmp_server: RtmpServer) -> None:
    rtmp_server.start()
    air = station(noise=True)
    push = air.push(rtmp_server.url("key"), SETTINGS.model_copy(update={"stall_seconds": 60.0}))
    await until(is_live(push))
    rtmp_server.pause()
    behind = air.studio.index + 4 * FPS  # by then everything between here and there is full
    await until(lambda: air.studio.index > behind)
    await asyncio.wait_for(push.close(), PATIENCE)
    assert push.state == "ended"


@pytest.mark.parametrize(
    ("name", "application", "says"),
    [
        ("key", "nowhere", "the server refused the application of the URL, or wants a login"),
        ("key?token=wrong", "locked", "the server refused to publish: wrong key, not authenticated, or in use"),
    ],
)
async def test_a_server_that_refuses_is_not_asked_for_ever(
    station: Any, rtmp_server: RtmpServer, name: str, application: str, says: str
) -> None:
    rtmp_server.start()
    air = station()
    push = air.push(rtmp_server.url(name, application))
    await until(lambda: push.over)
    assert push.report() == PushReport(
        push.id, "rtmp", f"rtmp://{rtmp_server.address}/{application}/…", "failed", says, MAX_REFUSALS - 1
    )
    assert air.seats.taken == 0


async def test_what_lets_a_push_in_is_neither_shown_nor_logged(
    station: Any, rtmp_server: RtmpServer, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    caplog.set_level(logging.DEBUG)
    rtmp_server.start()
    air = station()
    before = children()
    push = air.push(rtmp_server.url(f"private?token={TOKEN}", "locked"))
    await until(is_live(push))
    (process,) = children() - before
    command = Path(f"/proc/{process}/cmdline").read_text()
    rtmp_server.kill()
    await until(lambda: push.state == "retrying")
    shown = caplog.text + repr(push.target) + repr(air.history) + "".join(capfd.readouterr())
    assert "live" in shown
    for secret in ("private", TOKEN):
        assert secret not in shown
        assert secret not in command


async def test_a_push_that_never_gets_through_is_given_up(station: Any, rtmp_server: RtmpServer) -> None:
    air = station()
    push = air.push(rtmp_server.url("key"), SETTINGS.model_copy(update={"give_up_seconds": 0.3}))
    await until(lambda: push.over)
    assert push.state == "failed"
    assert push.report().error == "the server cannot be reached: Connection refused"
    assert push.report().retries >= 1


async def test_a_publishing_process_that_is_killed_is_replaced(station: Any, rtmp_server: RtmpServer) -> None:
    rtmp_server.start()
    air = station()
    before = children()
    push = air.push(rtmp_server.url("key"))
    await until(is_live(push))
    (process,) = children() - before
    os.kill(int(process), signal.SIGKILL)
    await until(lambda: push.state == "retrying")
    await until(is_live(push))
    assert [report.error for report in air.history] == ["", "the publishing process ended with -9", ""]


async def test_no_more_pushes_than_seats(station: Any, rtmp_server: RtmpServer) -> None:
    air = station()
    pushes = [air.push(rtmp_server.url(f"key{number}")) for number in range(2)]
    with pytest.raises(OverCapacity, match="2 pushes"):
        air.push(rtmp_server.url("key3"))
    await pushes[0].close()
    air.push(rtmp_server.url("key3"))


async def test_closing_ends_a_push_in_whatever_state(station: Any, rtmp_server: RtmpServer) -> None:
    air = station()
    connecting = air.push(rtmp_server.url("key"))
    await connecting.close()
    await connecting.close()
    assert connecting.state == "ended"
    retrying = air.push(
        rtmp_server.url("key"), SETTINGS.model_copy(update={"retry_seconds": 60, "retry_max_seconds": 60})
    )
    await until(lambda: retrying.state == "retrying")
    await asyncio.wait_for(retrying.close(), PATIENCE)
    assert retrying.state == "ended"


@pytest.fixture
async def whip_server() -> AsyncIterator[WhipServer]:
    server = WhipServer()
    await server.start()
    yield server
    await server.stop()


async def test_a_stream_is_published_by_whip(station: Any, whip_server: WhipServer) -> None:
    air = station()
    push = air.push(whip_server.url, token=WHIP_TOKEN)
    await until(is_live(push))
    await until(lambda: len(whip_server.pictures) >= 2 * FPS and len(whip_server.sound) >= 100)
    times = np.array([time for time, _ in whip_server.pictures])
    indices = np.array([read_index(luma) for _, luma in whip_server.pictures])
    np.testing.assert_allclose(times - times[0], (indices - indices[0]) / FPS, atol=1e-6)
    assert np.median(np.diff(indices)) == 1
    loud = [time for time, samples in whip_server.sound if np.abs(samples).max() > 0.25]
    assert 0.08 < len(loud) / len(whip_server.sound) < 0.16  # a tenth of every second
    assert push.report().target == whip_server.url.removesuffix("whip") + "…"

    await push.close()

    assert push.state == "ended"
    assert whip_server.requests == [("POST /whip", 201), ("DELETE /whip/1", 200)]


async def test_the_token_does_not_go_to_a_server_that_the_whip_server_names(
    station: Any, whip_server: WhipServer
) -> None:
    other = WhipServer()
    await other.start()
    try:
        whip_server.location = other.url
        push = station().push(whip_server.url, token=WHIP_TOKEN)
        await until(is_live(push))
        await push.close()
        assert push.state == "ended"
        assert whip_server.requests == [("POST /whip", 201)]
        assert other.requests == []
    finally:
        await other.stop()


async def test_a_whip_server_that_goes_is_tried_again(station: Any, whip_server: WhipServer) -> None:
    air = station()
    push = air.push(whip_server.url, token=WHIP_TOKEN)
    await until(lambda: whip_server.pictures)
    await whip_server.stop()
    await until(lambda: "cannot be reached" in push.report().error)
    whip_server.pictures.clear()
    await whip_server.start()
    await until(lambda: whip_server.pictures)
    assert push.state == "live"


@pytest.mark.parametrize("token", ["", "wrong"])
async def test_a_whip_server_that_refuses_is_not_asked_for_ever(
    station: Any, whip_server: WhipServer, token: str
) -> None:
    push = station().push(whip_server.url, token=token)
    await until(lambda: push.over)
    assert push.state == "failed"
    assert push.report().error.startswith("the server refused to publish: HTTP 401")
    assert len(whip_server.requests) == MAX_REFUSALS


async def test_a_whip_server_may_ask_for_key_frames(station: Any, whip_server: WhipServer) -> None:
    air = station(keyframe_seconds=8)
    await until(lambda: air.studio.index > 20)

    def keyframes() -> int:
        return sum(packet.starts for packet in air.sent)

    air.push(whip_server.url, token=WHIP_TOKEN)
    await until(lambda: whip_server.pictures)  # begins with a key frame, asked for
    before = keyframes()
    await whip_server.ask_for_a_key_frame()
    await until(lambda: keyframes() > before)
    index = [packet.pts for packet in air.sent if packet.starts][-1]
    assert index < 8 * FPS  # it did not come by itself


@pytest.mark.parametrize(
    ("status", "body", "says", "retried"),
    [
        (200, "<html>Hello</html>", "there is no WHIP server at this URL", False),
        (201, "v=0\r\nnonsense\r\n", "the server's answer is no SDP that fits the offer", False),
        (307, "", "the server refused to publish: HTTP 307 Temporary Redirect", False),
        (404, "", "the server refused to publish: HTTP 404 Not Found", False),
        (503, "", "the server is in trouble: HTTP 503 Service Unavailable", True),
    ],
)
async def test_other_answers_of_a_whip_server_are_told(
    station: Any, whip_server: WhipServer, status: int, body: str, says: str, retried: bool
) -> None:
    whip_server.always = status, body
    push = station().push(whip_server.url, token=WHIP_TOKEN)
    await until(lambda: push.over or push.report().retries > MAX_REFUSALS)
    assert push.report().error == says
    assert push.state == ("retrying" if retried else "failed")
    assert {line for line, _ in whip_server.requests} <= {"POST /whip", "DELETE /whip/1"}


async def test_a_whip_server_that_cannot_be_reached_by_udp_is_tried_again(
    station: Any, whip_server: WhipServer
) -> None:
    whip_server.unreachable = True
    push = station().push(whip_server.url, SETTINGS.model_copy(update={"stall_seconds": 0.5}), token=WHIP_TOKEN)
    await until(lambda: push.report().error == "the media connection did not come about (ICE, DTLS)")
    await until(lambda: push.report().retries)
    assert push.state == "retrying"
    assert ("DELETE /whip/1", 200) in whip_server.requests
