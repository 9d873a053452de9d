from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError
from puppet import BACKGROUND, OPEN, SIZE, TinyAvatar, TinyNarrator, until

from app.config import Settings
from app.engine.pool import OrderedPool
from app.errors import NegotiationFailed, NotFound, OverCapacity
from app.stream.ice import IceOptions, gather_as
from app.stream.live import LiveStream, StreamOptions
from app.stream.seats import Seats
from app.stream.timing import LatencyLog
from app.stream.whep import WhepViewer

SETTINGS = Settings(stream={"preset": "ultrafast", "crf": 12, "start_seconds": 60})


class Browser:
    """A WebRTC viewer with aiortc's own receiver and decoders; keeps what it sees and hears."""

    def __init__(self) -> None:
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.upper: list[float] = []
        self.loudness: list[float] = []
        self.ended = 0
        self._tasks: list[asyncio.Task[None]] = []

    async def offer(self) -> str:
        for kind in ("video", "audio"):
            transceiver = self.connection.addTransceiver(kind, direction="recvonly")
            gather_as(transceiver.receiver.transport.transport.iceGatherer._connection, IceOptions(loopback=True))
        await self.connection.setLocalDescription(await self.connection.createOffer())
        return str(self.connection.localDescription.sdp)

    async def accept(self, sdp: str) -> None:
        await self.connection.setRemoteDescription(RTCSessionDescription(sdp, "answer"))
        for transceiver in self.connection.getTransceivers():
            self._tasks.append(asyncio.create_task(self._receive(transceiver.receiver.track)))

    async def _receive(self, track: Any) -> None:
        try:
            while True:
                frame = await track.recv()
                if track.kind == "video":
                    self.upper.append(float(frame.to_ndarray(format="gray")[: SIZE // 2].mean()))
                else:
                    self.loudness.append(float(np.abs(frame.to_ndarray()).max()))
        except MediaStreamError:
            self.ended += 1

    async def close(self) -> None:
        await self.connection.close()
        await asyncio.gather(*self._tasks)


@pytest.fixture
def pool() -> Iterator[OrderedPool]:
    pool = OrderedPool(2)
    yield pool
    pool.close()


@pytest.fixture
async def make(pool: OrderedPool, tmp_path: Path) -> AsyncIterator[Any]:
    streams: list[LiveStream] = []

    def create(webrtc_seats: Seats | None = None, **options: Any) -> LiveStream:
        streams.append(
            LiveStream(
                TinyAvatar(),  # type: ignore[arg-type]
                voice="buzz",
                narrator=TinyNarrator(),
                pool=pool,
                settings=SETTINGS,
                folder=tmp_path,
                latency=LatencyLog(),
                options=StreamOptions(**options),
                webrtc_seats=webrtc_seats,
            )
        )
        return streams[-1]

    yield create
    for stream in streams:
        await stream.end()


async def join(stream: LiveStream) -> tuple[Browser, WhepViewer]:
    browser = Browser()
    viewer = await stream.whep(await browser.offer())
    await browser.accept(viewer.answer)
    return browser, viewer


def opened(browser: Browser) -> int:
    mouth = np.array([0, *browser.upper, 0]) > (BACKGROUND + OPEN) / 2
    return int(np.sum(np.diff(mouth.astype(int)) == 1))


async def test_speech_waits_until_webrtc_is_connected_and_is_seen_and_heard_whole(make: Any) -> None:
    stream = make()
    utterance = stream.say("0.4 0.4")
    browser, viewer = await join(stream)
    await until(lambda: utterance.state == "done")
    assert stream.report().viewers == {"whep": 1, "flv": 0, "mp4": 0, "rtmp": 0, "whip": 0}
    assert utterance.timings.milliseconds()["viewer"] > 0
    await until(lambda: opened(browser) == 2 and browser.upper[-1] < 60)
    assert max(browser.loudness) > 5000
    await stream.peer(viewer.id).close()
    assert stream.report().viewers["whep"] == 0
    with pytest.raises(NotFound):
        stream.peer(viewer.id)
    await until(lambda: stream.idle_since is not None)
    await browser.close()


async def test_a_viewer_who_joins_in_the_middle_gets_a_picture(make: Any) -> None:
    stream = make(start="now")
    utterance = stream.say("2.5")
    await until(lambda: stream.report().rendered > 10)
    browser, _ = await join(stream)
    await until(lambda: browser.upper)
    assert browser.upper[0] > 150
    assert utterance.state == "speaking"
    await browser.close()


async def test_viewers_of_all_transports_at_once(make: Any) -> None:
    stream = make()
    chunks = [stream.watch("flv"), stream.watch("mp4")]
    for each in chunks:
        await anext(each)
    browser, _ = await join(stream)
    await until(lambda: stream.report().viewers == {"whep": 1, "flv": 1, "mp4": 1, "rtmp": 0, "whip": 0})
    utterance = stream.say("0.3")
    await until(lambda: utterance.state == "done" and opened(browser) == 1)
    for each in chunks:
        await each.aclose()
    assert stream.report().viewers == {"whep": 1, "flv": 0, "mp4": 0, "rtmp": 0, "whip": 0}
    await browser.close()


async def test_a_stream_that_ends_by_itself_lets_its_viewers_play_out(make: Any) -> None:
    stream = make(once=True)
    stream.say("0.3")
    browser, _ = await join(stream)
    await until(lambda: browser.ended == 2)
    assert opened(browser) == 1
    assert browser.upper[-1] < 60
    await until(lambda: stream.state == "ended")
    await browser.close()


async def test_a_bad_offer_is_refused_and_nobody_is_counted(make: Any) -> None:
    stream = make()
    with pytest.raises(NegotiationFailed):
        await stream.whep("v=0\r\nnonsense")
    assert stream.report().viewers["whep"] == 0
    assert stream.idle_since is not None


async def test_webrtc_viewers_are_limited_over_all_streams(make: Any) -> None:
    seats = Seats(2, "WebRTC viewers")
    one, other = make(webrtc_seats=seats), make(webrtc_seats=seats)
    with pytest.raises(NegotiationFailed):
        await one.whep("v=0\r\nnonsense")
    assert seats.taken == 0
    browsers = [Browser() for _ in range(3)]
    offers = [await browser.offer() for browser in browsers]
    first = await one.whep(offers[0])
    await other.whep(offers[1])
    with pytest.raises(OverCapacity, match="2 WebRTC viewers"):
        await other.whep(offers[2])
    assert other._production.audience._seats.taken == 1
    await first.close()
    assert seats.taken == 1
    await other.whep(offers[2])
    await other.end()
    assert seats.taken == 0
    for browser in browsers:
        await browser.close()
