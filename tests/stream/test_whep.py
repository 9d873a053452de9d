from __future__ import annotations

import asyncio
import contextlib
import errno
import gc
import random
import socket
import threading
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import replace
from typing import Any

import aioice.ice
import pytest
from aiortc import RTCConfiguration, RTCPeerConnection, RTCRtpReceiver, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError
from patterns import FPS, Studio, read_index

from app.errors import IceRestartRefused, NegotiationFailed, OverCapacity
from app.stream.broadcast import Broadcast
from app.stream.ice import MAX_CANDIDATES, IceOptions, gather_as
from app.stream.packet import Packet
from app.stream.trickle import Section
from app.stream.whep import WhepViewer, answer

SKEW = 2  # frames by which pictures are sent ahead of their sound


class Station:
    """A stream that runs in a thread in real time, and what its viewers' callbacks told."""

    def __init__(self, **options: object) -> None:
        self.studio = Studio(**options)
        self.source: Broadcast[Packet] = Broadcast()
        self.requests = 0
        self.connected: list[WhepViewer] = []
        self.closed: list[WhepViewer] = []
        self.sent: list[Packet] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        begin, frame = time.monotonic(), 0
        late: list[list[Packet]] = []
        while not self._stop.wait(max(0.0, begin + frame / FPS - time.monotonic())):
            packets = self.studio.frame()
            late.append([packet for packet in packets if packet.kind != "video"])
            now = [packet for packet in packets if packet.kind == "video"]
            for packet in now + (late.pop(0) if len(late) > SKEW else []):
                self.sent.append(packet)
                self.source.publish(packet)
            frame += 1

    def request(self) -> None:
        self.requests += 1
        self.studio.video.request_keyframe()

    async def admit(self, offer: str, **options: Any) -> WhepViewer:
        options = {"ice": IceOptions(loopback=True), **options}
        return await answer(
            offer,
            self.source,
            request_keyframe=self.request,
            on_connected=self.connected.append,
            on_closed=self.closed.append,
            **options,
        )

    def __enter__(self) -> Station:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def station() -> Iterator[Station]:
    with Station(keyframe_seconds=1000) as running:
        yield running


class Client:
    """An independent viewer: aiortc's own receiver and decoders."""

    def __init__(self) -> None:
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.rtp: dict[str, list[Any]] = {"video": [], "audio": []}
        self.reports: dict[str, list[Any]] = {"video": [], "audio": []}

    async def offer(self, kinds: tuple[str, ...] = ("video", "audio"), direction: str = "recvonly") -> str:
        for kind in kinds:
            transceiver = self.connection.addTransceiver(kind, direction=direction)
            self._listen(transceiver.receiver, kind)
            gather_as(transceiver.receiver.transport.transport.iceGatherer._connection, IceOptions(loopback=True))
        await self.connection.setLocalDescription(await self.connection.createOffer())
        return self.connection.localDescription.sdp

    def _listen(self, receiver: Any, kind: str) -> None:
        handle_rtp, handle_rtcp = receiver._handle_rtp_packet, receiver._handle_rtcp_packet

        async def on_rtp(packet: Any, arrival_time_ms: int) -> None:
            self.rtp[kind].append(packet)
            await handle_rtp(packet, arrival_time_ms=arrival_time_ms)

        async def on_rtcp(packet: Any) -> None:
            if hasattr(packet, "sender_info"):
                self.reports[kind].append(packet.sender_info)
            await handle_rtcp(packet)

        receiver._handle_rtp_packet, receiver._handle_rtcp_packet = on_rtp, on_rtcp

    async def accept(self, sdp: str) -> None:
        await self.connection.setRemoteDescription(RTCSessionDescription(sdp, "answer"))

    def receiver(self, kind: str) -> Any:
        return next(each.receiver for each in self.connection.getTransceivers() if each.kind == kind)

    async def frames(self, kind: str, count: int) -> list[Any]:
        track = self.receiver(kind).track
        return [await asyncio.wait_for(track.recv(), 20) for _ in range(count)]

    async def close(self) -> None:
        await self.connection.close()


@pytest.fixture
async def clients() -> AsyncIterator[list[Client]]:
    made: list[Client] = []
    yield made
    for client in made:
        await client.close()


async def join(station: Station, clients: list[Client], **options: Any) -> tuple[Client, WhepViewer]:
    client = Client()
    clients.append(client)
    viewer = await station.admit(await client.offer(), **options)
    await client.accept(viewer.answer)
    return client, viewer


async def until(condition: Any) -> None:
    async with asyncio.timeout(30):
        while not condition():
            await asyncio.sleep(0.01)


async def test_pictures_and_sound_arrive(station: Station, clients: list[Client]) -> None:
    client, viewer = await join(station, clients)
    pictures, sound = await asyncio.gather(client.frames("video", 40), client.frames("audio", 60))
    seen = [read_index(frame.to_ndarray(format="gray")) for frame in pictures]
    assert seen == list(range(seen[0], seen[0] + 40))
    times = [frame.pts * frame.time_base for frame in pictures]
    assert [round((time - times[0]) * FPS) for time in times] == list(range(40))
    assert any(abs(frame.to_ndarray()).max() > 5000 for frame in sound)  # a beep a second
    assert viewer.connected
    assert station.connected == [viewer]
    assert station.source.subscribers == 2
    await viewer.close()
    await viewer.close()
    assert viewer.closed
    assert station.closed == [viewer]
    assert station.source.subscribers == 0


async def test_the_shared_bytes_are_sent_unchanged(station: Station, clients: list[Client]) -> None:
    client, viewer = await join(station, clients)
    await client.frames("audio", 20)
    sent = {packet.data for packet in station.sent if packet.kind == "opus"}
    assert {packet.payload for packet in client.rtp["audio"]} <= sent
    await viewer.close()


async def test_the_first_picture_is_a_key_frame_also_for_who_comes_late(
    station: Station, clients: list[Client]
) -> None:
    """Key frames are a thousand seconds apart here, unless asked for."""
    for _ in range(2):
        client, viewer = await join(station, clients)
        requests = station.requests
        (frame,) = await client.frames("video", 1)
        index = read_index(frame.to_ndarray(format="gray"))
        assert next(packet for packet in station.sent if packet.kind == "video" and packet.pts == index).keyframe
        assert station.requests > requests
        await viewer.close()


async def test_lost_pictures_are_asked_for_again(station: Station, clients: list[Client]) -> None:
    client, viewer = await join(station, clients)
    await client.frames("video", 3)
    requests = station.requests
    await client.receiver("video")._send_rtcp_pli(client.rtp["video"][0].ssrc)
    await until(lambda: station.requests > requests)
    keys = [packet.pts for packet in station.sent if packet.keyframe and packet.kind == "video"]
    await until(lambda: [packet.pts for packet in station.sent if packet.keyframe and packet.kind == "video"] != keys)
    await viewer.close()


async def test_sound_and_pictures_have_one_clock(station: Station, clients: list[Client]) -> None:
    """By the sender reports, though pictures are sent ahead of their sound."""
    client, viewer = await join(station, clients)
    frames = await client.frames("video", 20)
    await until(lambda: client.reports["video"] and client.reports["audio"])
    await viewer.close()

    def wall(kind: str, rtp_time: int, rate: int) -> float:
        report = client.reports[kind][-1]
        elapsed = (rtp_time - report.rtp_timestamp + (1 << 31)) % (1 << 32) - (1 << 31)
        return float(report.ntp_timestamp / (1 << 32) + elapsed / rate)

    index = read_index(frames[0].to_ndarray(format="gray"))
    zero_of_pictures = wall("video", client.rtp["video"][0].timestamp, 90_000) - index / FPS
    known: dict[bytes, list[float]] = {}
    for packet in station.sent:
        if packet.kind == "opus":
            known.setdefault(packet.data, []).append(packet.seconds)
    unique = [packet for packet in client.rtp["audio"] if len(known[packet.payload]) == 1]
    assert unique
    for packet in unique:
        zero_of_sound = wall("audio", packet.timestamp, 48_000) - known[packet.payload][0]
        assert abs(zero_of_sound - zero_of_pictures) < 0.001


async def test_the_answer(station: Station, clients: list[Client]) -> None:
    _, viewer = await join(station, clients)
    lines = viewer.answer.splitlines()
    codecs = [line.split(" ")[1] for line in lines if line.startswith("a=rtpmap:")]
    assert set(codecs) == {"H264/90000", "rtx/90000", "opus/48000/2"}
    profiles = [line.partition("profile-level-id=")[2] for line in lines if "profile-level-id" in line]
    assert profiles == ["42e01f", "42001f"]
    assert lines.count("a=sendonly") == 2
    assert any("127.0.0.1" in line for line in lines if line.startswith("a=candidate:"))
    await viewer.close()


async def test_the_answer_is_as_the_draft_wants_it(station: Station, clients: list[Client]) -> None:
    """Bundled, RTCP not apart, one media stream, all candidates in it."""
    _, viewer = await join(station, clients)
    session, *sections = viewer.answer.split("m=")
    assert "a=ice-options:trickle\r\n" in session
    assert "a=group:BUNDLE 0 1\r\n" in session
    streams = set()
    for section in sections:
        lines = section.splitlines()
        assert {"a=sendonly", "a=rtcp-mux", "a=rtcp-mux-only", "a=end-of-candidates"} <= set(lines)
        (media_stream,) = (line.split()[0] for line in lines if line.startswith("a=msid:"))
        streams.add(media_stream)
    assert len(sections) == 2
    assert len(streams) == 1
    await viewer.close()


def candidates(sdp: str) -> list[str]:
    return [line.removeprefix("a=candidate:") for line in sdp.splitlines() if line.startswith("a=candidate:")]


def fragment_of(offer: str) -> Section:
    """What a viewer would send who has found its candidates after `offer`."""
    values = dict(line.removeprefix("a=").partition(":")[::2] for line in offer.splitlines() if line.startswith("a="))
    section = offer.split("m=")[1]  # the first one is that of the bundle
    (mid,) = (line.removeprefix("a=mid:") for line in section.splitlines() if line.startswith("a=mid:"))
    return Section(mid, values["ice-ufrag"], values["ice-pwd"], candidates(section))


async def test_trickled_candidates_are_what_connects(station: Station, clients: list[Client]) -> None:
    """Neither side knows the other at first, so that only the server's checks can bring them together."""
    client = Client()
    clients.append(client)
    offer = await client.offer()
    viewer = await station.admit(_without(offer, "a=candidate"))
    await client.accept(_without(_without(viewer.answer, "a=candidate"), "a=end-of-candidates"))
    await asyncio.sleep(0.3)
    assert not viewer.connected
    assert client.connection.iceConnectionState == "checking"
    await viewer.trickle([fragment_of(offer)])
    assert len(await client.frames("video", 5)) == 5
    await viewer.trickle([fragment_of(offer)])  # once more, and late
    assert len(await client.frames("video", 5)) == 5
    await viewer.close()


async def test_useless_candidates_are_passed_over(station: Station, clients: list[Client]) -> None:
    client = Client()
    clients.append(client)
    offer = await client.offer()
    viewer = await station.admit(_without(offer, "a=candidate"))
    section = fragment_of(offer)
    section.candidates = [
        "1 1 tcp 1518280447 192.0.2.1 9 typ host tcptype active",
        "2 1 udp 2113937151 0d9c3cd5.local 51341 typ host",
        *(f"{port} 1 udp 2113937151 192.0.2.1 {port} typ host" for port in range(1000, 1100)),
        *(f"{port} 1 udp 2113937151 192.0.2.1 {port} typ host" for port in range(1000, 1100)),
    ]
    await viewer.trickle([section])
    known = viewer._transports[0].remote_candidates
    assert len(known) == MAX_CANDIDATES
    assert {each.host for each in known} == {"192.0.2.1"}
    await viewer.close()
    await viewer.trickle([section])  # overtaken by the end


async def test_foreign_fragments_are_refused_and_change_nothing(station: Station, clients: list[Client]) -> None:
    client = Client()
    clients.append(client)
    offer = await client.offer()
    viewer = await station.admit(_without(offer, "a=candidate"))
    await client.accept(viewer.answer)
    good = fragment_of(offer)
    for changed in (replace(good, ufrag="other"), replace(good, password="x" * 24)):
        with pytest.raises(IceRestartRefused):
            await viewer.trickle([good, changed])
    with pytest.raises(NegotiationFailed, match="'9'"):
        await viewer.trickle([good, replace(good, mid="9")])
    assert len(await client.frames("video", 3)) == 3  # the connection is as it was
    await viewer.close()


async def test_a_used_up_range_of_ports_is_no_fault_of_the_offer(station: Station, clients: list[Client]) -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        client = Client()
        clients.append(client)
        with pytest.raises(OverCapacity, match=str(port)):
            await station.admit(await client.offer(), ice=IceOptions(ports=range(port, port + 1), loopback=True))
    assert station.source.subscribers == 0


async def test_advertised_addresses(station: Station, clients: list[Client]) -> None:
    client = Client()
    clients.append(client)
    viewer = await station.admit(await client.offer(), ice=IceOptions(("203.0.113.5",)))
    hosts = [line.split()[4] for line in viewer.answer.splitlines() if line.startswith("a=candidate:")]
    assert set(hosts) <= {"203.0.113.5"}
    await viewer.close()


@pytest.mark.parametrize("kind", ["video", "audio"])
async def test_one_kind_alone(station: Station, clients: list[Client], kind: str) -> None:
    client = Client()
    clients.append(client)
    viewer = await station.admit(await client.offer((kind,)))
    await client.accept(viewer.answer)
    assert len(await client.frames(kind, 5)) == 5
    assert station.source.subscribers == 1
    await viewer.close()


async def test_hidden_addresses_are_not_waited_for(
    station: Station, clients: list[Client], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of the offer's candidates are mDNS names; the viewer's own checks reveal where it is."""

    async def never(_: object) -> None:
        raise AssertionError("mDNS was asked")

    monkeypatch.setattr(aioice.ice, "get_or_create_mdns_protocol", never)
    client = Client()
    clients.append(client)
    offer = [
        " ".join([*parts[:4], "4b7e2c1a.local", *parts[5:]]) if line.startswith("a=candidate:") else line
        for line in (await client.offer()).splitlines()
        for parts in [line.split()]
    ]
    assert any(".local" in line for line in offer)
    viewer = await station.admit("\r\n".join([*offer, ""]))
    await client.accept(viewer.answer)
    assert await client.frames("video", 2)
    await viewer.close()


async def test_who_never_connects_is_closed(station: Station, clients: list[Client]) -> None:
    client = Client()
    clients.append(client)
    viewer = await station.admit(await client.offer(), connect_seconds=0.1)
    await until(lambda: viewer.closed)
    assert not viewer.connected
    assert station.connected == []
    assert station.closed == [viewer]
    assert station.source.subscribers == 0


async def test_who_leaves_is_closed(station: Station, clients: list[Client]) -> None:
    client, viewer = await join(station, clients)
    await client.frames("video", 2)
    await client.close()
    await until(lambda: viewer.closed)
    assert station.closed == [viewer]
    assert station.source.subscribers == 0


async def test_the_end_of_the_stream_ends_the_viewer(station: Station, clients: list[Client]) -> None:
    client, viewer = await join(station, clients)
    await client.frames("video", 2)
    station.source.close()
    await until(lambda: viewer.closed)
    with pytest.raises(MediaStreamError):
        await client.frames("video", 1000)


async def test_closing_while_it_connects(station: Station, clients: list[Client]) -> None:
    _, viewer = await join(station, clients)
    await asyncio.sleep(0)
    await asyncio.gather(viewer.close(), viewer.close())
    assert station.closed == [viewer]
    assert station.source.subscribers == 0


def _without(offer: str, start: str) -> str:
    return "\r\n".join(line for line in offer.splitlines() if not line.startswith(start)) + "\r\n"


@pytest.mark.parametrize(
    "offer", ["", "hello", "v=0", "v=0\r\n", "\0\1\2", "{}", "m=video\r\n", "v=0\r\nm=video x y z\r\n"]
)
async def test_what_is_no_offer_is_refused(station: Station, offer: str) -> None:
    with pytest.raises(NegotiationFailed, match="offer"):
        await station.admit(offer)


@pytest.mark.parametrize(
    "missing", ["a=ice-ufrag", "a=ice-pwd", "a=fingerprint", "a=setup", "a=rtcp-mux", "a=mid", "a=rtpmap", "a=fmtp"]
)
async def test_incomplete_offers_are_refused_or_answered(station: Station, clients: list[Client], missing: str) -> None:
    """Nothing but NegotiationFailed may come out."""
    client = Client()
    clients.append(client)
    offer = _without(await client.offer(), missing)
    with contextlib.suppress(NegotiationFailed):
        viewer = await station.admit(offer)
        await viewer.close()
    assert station.source.subscribers == 0


@pytest.mark.parametrize("seed", range(4))
async def test_damaged_offers_are_refused_or_answered(station: Station, clients: list[Client], seed: int) -> None:
    """Nothing but NegotiationFailed may come out, and no socket may stay open."""
    chance = random.Random(seed)
    client = Client()
    clients.append(client)
    whole = (await client.offer()).splitlines()
    for _ in range(15):
        lines = list(whole)
        for _ in range(chance.randint(1, 3)):
            place = chance.randrange(len(lines))
            damage = chance.randrange(4)
            if damage == 0:
                del lines[place]
            elif damage == 1:
                lines.insert(chance.randrange(len(lines)), lines[place])
            elif damage == 2:
                lines[place] = lines[place][: chance.randrange(len(lines[place]) + 1)]
            else:
                cut = chance.randrange(len(lines[place]) + 1)
                lines[place] = lines[place][:cut] + chance.choice("\0 0A\xff") + lines[place][cut + 1 :]
        with contextlib.suppress(NegotiationFailed):
            viewer = await station.admit("\r\n".join([*lines, ""]))
            await viewer.close()
    gc.collect()  # an open socket would be a ResourceWarning, an error here
    assert station.source.subscribers == 0


async def test_offers_without_h264_are_refused(station: Station, clients: list[Client]) -> None:
    client = Client()
    clients.append(client)
    transceiver = client.connection.addTransceiver("video", direction="recvonly")
    codecs = RTCRtpReceiver.getCapabilities("video").codecs
    transceiver.setCodecPreferences([codec for codec in codecs if codec.mimeType == "video/VP8"])
    await client.connection.setLocalDescription(await client.connection.createOffer())
    with pytest.raises(NegotiationFailed, match=r"H\.264 only.*: VP8"):
        await station.admit(client.connection.localDescription.sdp)


async def test_offers_with_another_h264_are_refused(station: Station, clients: list[Client]) -> None:
    client = Client()
    clients.append(client)
    offer = (await client.offer(("video",))).replace("42e01f", "640c1f").replace("42001f", "4d001f")
    with pytest.raises(NegotiationFailed) as caught:
        await station.admit(offer)
    assert "baseline" in caught.value.advice


@pytest.mark.parametrize("direction", ["sendonly", "inactive"])
async def test_offers_that_want_nothing_are_refused(station: Station, clients: list[Client], direction: str) -> None:
    client = Client()
    clients.append(client)
    with pytest.raises(NegotiationFailed, match="receive"):
        await station.admit(await client.offer(direction=direction))


async def test_a_data_channel_alone_is_refused(station: Station, clients: list[Client]) -> None:
    client = Client()
    clients.append(client)
    client.connection.createDataChannel("talk")
    await client.connection.setLocalDescription(await client.connection.createOffer())
    with pytest.raises(NegotiationFailed, match="receive"):
        await station.admit(client.connection.localDescription.sdp)


async def test_more_than_a_video_and_an_audio_section_is_refused(station: Station, clients: list[Client]) -> None:
    for extra in ("video", "talk"):
        client = Client()
        clients.append(client)
        if extra == "talk":
            client.connection.createDataChannel("talk")
        kinds = ("video", "audio", "video") if extra == "video" else ("video", "audio")
        with pytest.raises(NegotiationFailed, match="more than"):
            await station.admit(await client.offer(kinds))


async def test_without_sockets_the_server_is_full_and_the_offer_is_not_blamed(
    station: Station, clients: list[Client], monkeypatch: pytest.MonkeyPatch
) -> None:
    client = Client()
    clients.append(client)
    offer = await client.offer()

    async def no_files(*_: object, **__: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as patch:
        patch.setattr(asyncio.get_running_loop(), "create_datagram_endpoint", no_files)
        with pytest.raises(OverCapacity, match="no UDP socket"):
            await station.admit(offer)
    with monkeypatch.context() as patch:
        patch.setattr(RTCPeerConnection, "createAnswer", no_files)
        with pytest.raises(OverCapacity, match="Too many open files"):
            await station.admit(offer)
    viewer = await station.admit(offer)
    await viewer.close()
    assert station.source.subscribers == 0
