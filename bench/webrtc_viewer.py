"""A viewer over WebRTC in a process of its own: aiortc's receiver and decoders, by arrival."""

from __future__ import annotations

import asyncio
import multiprocessing
import queue
import time
from dataclasses import dataclass
from typing import Any, Self

import av
import httpx
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError

from app.engine.avatar import load_avatar
from app.stream.ice import IceOptions, gather_as
from bench.mouth import MouthGauge
from bench.recorded import FOLDER
from bench.watched import Series, level, luma, series

BLOCK = 192
"""Samples whose loudness is taken at once: a fifth of an Opus packet."""
START_SECONDS = 60.0


@dataclass(frozen=True)
class Arrived:
    """What came out of the decoders, by Unix time: the mouth of every picture, and how loud the sound was (dB)."""

    mouth: Series
    sound: Series


class WebrtcViewer:
    """Watches until the stream ends. A context manager, entered when pictures come.

    Attributes:
        arrived: what came, after the end.
    """

    def __init__(self, url: str) -> None:
        self.arrived: Arrived | None = None
        context = multiprocessing.get_context("spawn")
        self._results: multiprocessing.Queue[Arrived | str] = context.Queue()
        self._process = context.Process(target=_main, args=(url, self._results), daemon=True)

    def __enter__(self) -> Self:
        self._process.start()
        if (said := self._results.get(timeout=START_SECONDS)) != "watching":
            raise RuntimeError(f"the WebRTC viewer failed: {said}")
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.join()

    def join(self) -> None:
        """Wait until the stream has ended.

        Raises:
            RuntimeError: the viewer failed meanwhile.
        """
        try:
            arrived = self._results.get(timeout=START_SECONDS)
        except queue.Empty:
            arrived = "it does not see the end of the stream"
        if isinstance(arrived, str):
            raise RuntimeError(f"the WebRTC viewer failed: {arrived}")
        self.arrived = arrived


def _main(url: str, results: Any) -> None:
    try:
        results.put(asyncio.run(_watch(url, results)))
    except Exception as error:
        results.put(f"{type(error).__name__}: {error}")


async def _watch(url: str, results: Any) -> Arrived:
    gauge = MouthGauge(load_avatar(FOLDER).pack.background)
    mouth: list[tuple[float, float]] = []
    sound: list[tuple[float, float]] = []
    peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    try:
        for kind in ("video", "audio"):
            receiver = peer.addTransceiver(kind, direction="recvonly").receiver
            # aiortc never offers 127.0.0.1; the service does.
            gather_as(receiver.transport.transport.iceGatherer._connection, IceOptions(loopback=True))
        await peer.setLocalDescription(await peer.createOffer())
        async with httpx.AsyncClient(timeout=START_SECONDS) as http:
            offer, head = peer.localDescription.sdp, {"Content-Type": "application/sdp"}
            answer = (await http.post(url, content=offer, headers=head)).raise_for_status()
        await peer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))
        video, audio = (transceiver.receiver.track for transceiver in peer.getTransceivers())

        async def see() -> None:
            while True:
                picture: av.VideoFrame = await video.recv()
                arrived = time.time()
                if not mouth:
                    results.put("watching")
                mouth.append((arrived, gauge(luma(picture))))

        async def hear() -> None:
            while True:
                frame: av.AudioFrame = await audio.recv()
                arrived = time.time()
                samples = frame.to_ndarray().reshape(-1, len(frame.layout.channels)).mean(1) / 32768
                levels = level(samples, BLOCK)
                sound.extend((arrived + n * BLOCK / frame.sample_rate, each) for n, each in enumerate(levels))

        ended = await asyncio.gather(see(), hear(), return_exceptions=True)
        for error in ended:
            if not isinstance(error, MediaStreamError):
                raise error
    finally:
        await peer.close()
    return Arrived(series(mouth), series(sorted(sound)))
