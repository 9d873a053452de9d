from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import pytest
from aiortc import RTCPeerConnection, RTCRtpSender
from aiortc.mediastreams import MediaStreamError
from aiortc.rtp import RTCP_PSFB_FIR, RTCP_PSFB_PLI, RtcpPsfbPacket, RtcpSdesPacket, RtcpSenderInfo, RtcpSrPacket
from patterns import Studio

from app.stream.broadcast import Broadcast
from app.stream.packet import Packet
from app.stream.rtp import NTP_SECOND, PacketTrack, WallClock, attach, codecs


class Lost:
    def __init__(self) -> None:
        self.count = 0

    def __call__(self) -> None:
        self.count += 1


def test_the_clock_is_set_once() -> None:
    now = [1000 * NTP_SECOND]
    clock = WallClock(lambda: now[0])
    assert clock.ntp(2.5) == 1000 * NTP_SECOND
    now[0] += 77 * NTP_SECOND
    assert clock.ntp(3.5) == 1001 * NTP_SECOND
    assert clock.ntp(0.0) == 997.5 * NTP_SECOND


def test_constrained_baseline_and_opus_are_preferred_and_nothing_else_is_offered() -> None:
    video = [(codec.mimeType, codec.parameters.get("profile-level-id")) for codec in codecs("video")]
    assert video[0] == ("video/H264", "42e01f")
    assert {name for name, _ in video} == {"video/H264", "video/rtx"}
    assert {codec.mimeType for codec in codecs("audio")} == {"audio/opus"}
    only = [codec.parameters.get("profile-level-id") for codec in codecs("video", ("42001f",))]
    assert set(only) == {"42001f", None}


async def test_pictures_begin_with_a_key_frame_that_is_asked_for() -> None:
    studio, source, lost = Studio(), Broadcast[Packet](), Lost()
    for packet in studio.frames(5):
        source.publish(packet)
    track = PacketTrack("video", source, WallClock(), lost)
    assert source.subscribers == lost.count == 0  # not before it is read
    task = asyncio.create_task(track.recv())
    await asyncio.sleep(0)
    assert lost.count == 1
    for keyframe in (False, True):
        for packet in studio.frame(keyframe=keyframe):
            source.publish(packet)
    sent = await task
    assert sent.is_keyframe
    assert sent.pts == 6
    assert float(sent.pts * sent.time_base) == track.sent.seconds  # type: ignore[union-attr]


async def test_idle_pictures_can_be_left_out_and_speech_goes_on_from_its_key_frame() -> None:
    studio, source = Studio(), Broadcast[Packet]()
    track = PacketTrack("video", source, WallClock(), Lost(), idle=False)
    receiving = asyncio.create_task(track.recv())
    await asyncio.sleep(0)

    def publish(*, keyframe: bool = False, idle: bool = False) -> int:
        (packet,) = (each for each in studio.frame(keyframe=keyframe) if each.kind == "video")
        source.publish(replace(packet, idle=idle))
        return packet.pts

    publish(keyframe=True, idle=True)
    publish(idle=True)
    first = publish(keyframe=True)
    assert (await receiving).pts == first
    second = publish()
    publish(idle=True)
    publish()  # needs a picture that was left out
    third = publish(keyframe=True)
    assert [(await track.recv()).pts for _ in range(2)] == [second, third]


async def test_sound_begins_at_once_and_asks_for_nothing() -> None:
    studio, source, lost = Studio(), Broadcast[Packet](), Lost()
    track = PacketTrack("opus", source, WallClock(), lost)
    assert track.kind == "audio"
    task = asyncio.create_task(track.recv())
    await asyncio.sleep(0)
    packets = studio.frame()
    for packet in packets:
        source.publish(packet)
    assert bytes(await task) == next(packet.data for packet in packets if packet.kind == "opus")
    assert lost.count == 0


async def test_who_was_too_slow_asks_again() -> None:
    studio, source, lost = Studio(keyframe_seconds=0.4), Broadcast[Packet](queue_seconds=1.0), Lost()
    track = PacketTrack("video", source, WallClock(), lost)
    task = asyncio.create_task(track.recv())
    await asyncio.sleep(0)
    for packet in studio.frames(1):
        source.publish(packet)
    await task
    for packet in studio.frames(30):
        source.publish(packet)
    assert (await track.recv()).is_keyframe
    assert lost.count == 2
    await track.recv()
    assert lost.count == 2


async def test_it_ends_with_the_source() -> None:
    source: Broadcast[Packet] = Broadcast()
    track = PacketTrack("video", source, WallClock(), Lost())
    ended = Lost()
    track.on("ended", ended)
    task = asyncio.create_task(track.recv())
    await asyncio.sleep(0)
    source.close()
    with pytest.raises(MediaStreamError):
        await task
    assert ended.count == 1
    with pytest.raises(MediaStreamError):
        await track.recv()


async def test_stopping_leaves_the_source() -> None:
    source: Broadcast[Packet] = Broadcast()
    track = PacketTrack("video", source, WallClock(), Lost())
    task = asyncio.create_task(track.recv())
    await asyncio.sleep(0)
    assert source.subscribers == 1
    track.stop()
    assert source.subscribers == 0
    with pytest.raises(MediaStreamError):
        await task


class _Wire:
    """What the sender needs of a DTLS transport, keeping what is sent."""

    state = "new"

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    async def _send_rtp(self, data: bytes) -> None:
        self.sent.append(data)


@pytest.mark.parametrize("feedback", [RTCP_PSFB_PLI, RTCP_PSFB_FIR])
async def test_aiortc_hands_key_frame_requests_on(feedback: int) -> None:
    """The private method that is replaced is the one aiortc calls."""
    track, asked = PacketTrack("video", Broadcast[Packet](), WallClock(), Lost()), Lost()
    sender = RTCRtpSender(track, _Wire())  # type: ignore[arg-type]
    attach(sender, track, asked)
    await sender._handle_rtcp_packet(RtcpPsfbPacket(fmt=feedback, ssrc=1, media_ssrc=sender._ssrc))
    assert asked.count == 1


async def test_aiortc_reports_the_time_of_the_stream() -> None:
    studio, source, wire = Studio(), Broadcast[Packet](), _Wire()
    clock = WallClock(lambda: 1000 * NTP_SECOND)
    track = PacketTrack("video", source, clock, Lost())
    sender = RTCRtpSender(track, wire)  # type: ignore[arg-type]
    attach(sender, track, Lost())

    def report() -> list[Any]:
        return [RtcpSrPacket(1, RtcpSenderInfo(5, 6, 7, 8)), RtcpSdesPacket()]

    await sender._send_rtcp(report())
    assert wire.sent == []  # nothing sent, nothing to report
    task = asyncio.create_task(track.recv())
    await asyncio.sleep(0)
    for packet in studio.frames(3):
        source.publish(packet)
    await task
    await track.recv()
    await track.recv()
    await sender._send_rtcp(report())
    ((sent,),) = [[wire.sent[-1]]]
    assert int.from_bytes(sent[8:16], "big") == 1000 * NTP_SECOND + round(0.08 * NTP_SECOND)


async def test_what_is_wrapped_exists() -> None:
    """aiortc's private names; this fails when a new version has others."""
    connection = RTCPeerConnection()
    sender = connection.addTransceiver("video").sender
    assert callable(sender._send_keyframe)
    assert asyncio.iscoroutinefunction(sender._send_rtcp)
    await connection.close()
