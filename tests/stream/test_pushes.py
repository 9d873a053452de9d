"""Pushes as part of a stream: what they make it do, and what they do not do to its viewers."""

from __future__ import annotations

import asyncio
import io
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError
from puppet import BACKGROUND, FPS, OPEN, SIZE, TinyAvatar, TinyNarrator, until, watch_file
from rtmp_server import RtmpServer

from app.config import Settings
from app.engine.pool import OrderedPool
from app.errors import Gone, NotFound, OverCapacity
from app.stream.events import Event
from app.stream.ice import IceOptions, gather_as
from app.stream.live import LiveStream, StreamOptions
from app.stream.push.pushes import KEPT_OVER
from app.stream.push.target import PushTarget, push_target
from app.stream.timing import LatencyLog

SETTINGS = Settings(
    stream={"preset": "ultrafast", "crf": 12, "start_seconds": 60, "keyframe_seconds": 0.5, "max_kbps": 4000},
    push={"stall_seconds": 1, "retry_seconds": 0.1, "retry_max_seconds": 0.3, "max": 2},
)
NOWHERE = push_target("rtmp://127.0.0.1:1/live/key")


@pytest.fixture(autouse=True)
def nothing_is_too_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine must not change what the tests see."""
    monkeypatch.setattr("app.stream.production.DROP_LATE", 60.0)


class NoisyAvatar(TinyAvatar):
    """Fills a server's buffers fast."""

    noise = np.random.default_rng(3).integers(-60, 60, (8, SIZE, SIZE))

    def render(self, coefficients: Any, loop_frame: int, out: Any) -> None:
        super().render(coefficients, loop_frame, out)
        out[:SIZE] = np.clip(out[:SIZE] + self.noise[loop_frame % 8], 16, 235)


class Stage:
    """A stream, and what happens to it."""

    def __init__(self, pool: OrderedPool, folder: Path, avatar: TinyAvatar, options: StreamOptions) -> None:
        self.stream = LiveStream(
            avatar,  # type: ignore[arg-type]
            voice="buzz",
            narrator=TinyNarrator(),
            pool=pool,
            settings=SETTINGS,
            folder=folder,
            latency=LatencyLog(),
            options=options,
        )
        self.events: list[Event] = []
        self.listener = asyncio.create_task(self._listen())

    async def _listen(self) -> None:
        async for event in self.stream.events():
            self.events.append(event)

    def state(self, number: int = 0) -> str:
        return self.stream.report().pushes[number].state


@pytest.fixture
async def stage(tmp_path: Path) -> AsyncIterator[Any]:
    pool = OrderedPool(2)
    stages: list[Stage] = []

    def make(avatar: TinyAvatar | None = None, **options: Any) -> Stage:
        stages.append(Stage(pool, tmp_path, avatar or TinyAvatar(), StreamOptions(**options)))
        return stages[-1]

    yield make
    for each in stages:
        await each.stream.end()
        await each.listener
    pool.close()


def target(server: RtmpServer, application: str = "live") -> PushTarget:
    return push_target(server.url("key", application))


async def test_a_push_is_a_viewer_and_gets_every_word(stage: Any, rtmp_server: RtmpServer) -> None:
    live = stage(once=True)
    live.stream.say("0.3 0.2 0.4")
    live.stream.push(target(rtmp_server, "kept"))
    await until(lambda: live.state() == "retrying")
    assert live.stream.state == "waiting"  # for the push, that no word be lost
    assert live.stream.idle_since is None
    rtmp_server.start()
    await until(lambda: live.state() == "live")
    assert live.stream.report().viewers == {"whep": 0, "flv": 0, "mp4": 0, "rtmp": 1, "whip": 0}
    await until(lambda: live.stream.ended_at is not None)
    assert live.state() == "ended"
    seen = await asyncio.to_thread(watch_file, str(rtmp_server.kept("key")))
    opened = (seen.upper > (BACKGROUND + OPEN) / 2).astype(int)
    begins = [*np.flatnonzero(np.diff(opened, prepend=0) == 1)]
    assert [int(np.argmin(opened[begin:])) for begin in begins] == pytest.approx([7.5, 5, 10], abs=1)  # frames
    np.testing.assert_allclose(np.diff(seen.times), 1 / FPS, atol=2e-3)
    for begin in begins[1:]:
        at = seen.times[begin]
        assert seen.loud(at - 0.07) < 0.1 < seen.loud(at + 0.03)
    pushed = [event.data for event in live.events if event.name == "push"]
    (report,) = live.stream.report().pushes
    assert [event["state"] for event in pushed][:2] == ["retrying", "live"]
    assert {event["id"] for event in pushed} == {report.id}
    assert pushed[0]["error"] == "the server cannot be reached: Connection refused"
    assert pushed[1]["error"] is None


async def test_a_push_gets_idle_pictures_also_where_a_page_has_its_own(stage: Any, rtmp_server: RtmpServer) -> None:
    rtmp_server.start()
    live = stage(idle="local")
    live.stream.push(target(rtmp_server))
    await until(lambda: live.state() == "live")
    await until(lambda: live.stream.report().rendered >= 10)
    await live.stream.end_push(live.stream.report().pushes[0].id)
    assert live.state() == "ended"
    rendered = live.stream.report().rendered
    await asyncio.sleep(0.5)
    assert live.stream.report().rendered - rendered <= 5  # those that were on their way
    assert live.stream.idle_since is not None


async def test_viewers_do_not_notice_that_a_server_stands_still(stage: Any, rtmp_server: RtmpServer) -> None:
    rtmp_server.start()
    live = stage(NoisyAvatar())
    live.stream.say("60")  # while it speaks no sound is ever left out, however busy the machine is
    received = bytearray()

    async def watch() -> None:
        async for chunk in live.stream.watch("flv"):
            received.extend(chunk)

    watching = asyncio.create_task(watch())
    browser = Browser()
    await browser.watch(live.stream)
    live.stream.push(target(rtmp_server))
    await until(lambda: live.state() == "live" and browser.times)
    rtmp_server.pause()
    await until(lambda: live.state() == "retrying")
    rendered = live.stream.report().rendered
    await until(lambda: live.stream.report().rendered > rendered + FPS)
    rtmp_server.resume()
    await until(lambda: live.state() == "live")
    rendered = live.stream.report().rendered
    await until(lambda: live.stream.report().rendered > rendered + FPS)
    await live.stream.end()
    await watching
    await browser.close()
    seen = watch_file(io.BytesIO(bytes(received)), "flv")
    assert len(seen.times) > 3 * FPS
    np.testing.assert_allclose(np.diff(seen.times), 1 / FPS, atol=2e-3)
    assert len(seen.sound) / 48_000 == pytest.approx(seen.times[-1] - seen.times[0], abs=0.2)
    assert min(seen.loud(time) for time in seen.times[5:-10]) > 0.1  # without a hole
    assert len(browser.times) > 3 * FPS
    np.testing.assert_allclose(np.diff(browser.times), 1 / FPS, atol=2e-3)


async def test_no_more_than_the_service_allows_and_the_old_are_forgotten(stage: Any) -> None:
    live = stage()
    for _ in range(2):
        live.stream.push(NOWHERE)
    with pytest.raises(OverCapacity):
        live.stream.push(NOWHERE)
    with pytest.raises(NotFound):
        await live.stream.end_push("nobody")
    for _ in range(KEPT_OVER + 4):
        await live.stream.end_push(live.stream.report().pushes[-1].id)
        live.stream.push(NOWHERE)
    states = [push.state for push in live.stream.report().pushes]
    assert states.count("ended") == KEPT_OVER
    assert len(states) == KEPT_OVER + 2
    await live.stream.end()
    assert {push.state for push in live.stream.report().pushes} == {"ended"}
    with pytest.raises(Gone):
        live.stream.push(NOWHERE)


class Browser:
    """A WebRTC viewer; keeps the times of its pictures."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self._connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self._receiving: asyncio.Task[None] | None = None

    async def watch(self, stream: LiveStream) -> None:
        transceiver = self._connection.addTransceiver("video", direction="recvonly")
        gather_as(transceiver.receiver.transport.transport.iceGatherer._connection, IceOptions(loopback=True))
        await self._connection.setLocalDescription(await self._connection.createOffer())
        viewer = await stream.whep(self._connection.localDescription.sdp)
        await self._connection.setRemoteDescription(RTCSessionDescription(viewer.answer, "answer"))
        self._receiving = asyncio.create_task(self._receive(transceiver.receiver.track))

    async def _receive(self, track: Any) -> None:
        try:
            while True:
                self.times.append((await track.recv()).time)
        except MediaStreamError:
            pass

    async def close(self) -> None:
        await self._connection.close()
        assert self._receiving is not None
        await self._receiving
