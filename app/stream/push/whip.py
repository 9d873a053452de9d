"""A stream to a WHIP server (RFC 9725), by aiortc: the packets go out as they are.

FFmpeg's `whip` muxer was tried first. It does not answer the checks by which a peer makes sure that it is still wanted
(consent, RFC 7675), so that aiortc and browsers hang up after half a minute; nor requests for key frames.
"""

from __future__ import annotations

import asyncio
import threading
import urllib.error
import urllib.request
from collections.abc import Callable
from http import HTTPStatus
from typing import Any, BinaryIO
from urllib.parse import urljoin, urlsplit

from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription

from app.stream.broadcast import Broadcast
from app.stream.ice import IceOptions, gather_as, usable_candidates
from app.stream.packet import Packet
from app.stream.push.pipe import PublishOrder, read_packet
from app.stream.push.publication import Failure, PublishingFailed, reason, within
from app.stream.rtp import KINDS, PacketTrack, WallClock, attach, codecs

MAX_ANSWER = 65_536  # bytes
LINGER_SECONDS = 0.2  # after the last packet, for it to arrive
CLOSE_SECONDS = 0.5  # for the server to say that it has understood


class WhipPublication:
    """See `app.stream.push.publication.Publication`."""

    def __init__(self, order: PublishOrder) -> None:
        self._order = order
        self._runner = asyncio.Runner()
        self._packets: Broadcast[Packet] = Broadcast()
        self._resource = ""  # where the server can be told to end

    def connect(self, request_keyframe: Callable[[], None]) -> None:
        """Offer, read the answer, and wait until media can flow."""
        self._runner.run(self._connect(request_keyframe))

    def feed(self, source: BinaryIO) -> None:
        """Send packets until the input ends or the server goes."""
        reader = threading.Thread(target=self._read, args=(source,), daemon=True)
        reader.start()
        self._runner.run(self._wait())

    def close(self) -> None:
        """Tell the server, then the peer."""
        try:
            if self._resource:
                self._request(self._resource, "DELETE", CLOSE_SECONDS)
        finally:
            with within(CLOSE_SECONDS):
                self._runner.run(self._connection.close())
                self._runner.close()

    def _read(self, source: BinaryIO) -> None:
        while (packet := read_packet(source)) is not None:
            self._packets.publish(packet)
        self._packets.close()

    async def _connect(self, request_keyframe: Callable[[], None]) -> None:
        self._connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self._connection.on("connectionstatechange", self._state_changed)
        self._connected, self._gone, self._over = asyncio.Event(), asyncio.Event(), asyncio.Event()
        clock = WallClock()
        tracks = set()
        for kind, packets in KINDS.items():
            track = PacketTrack(packets, self._packets, clock, request_keyframe)
            tracks.add(track)
            track.on("ended", lambda track=track: self._track_ended(tracks, track))
            transceiver = self._connection.addTransceiver(track, direction="sendonly")
            transceiver.setCodecPreferences(codecs(kind, ("42e01f",)))
            attach(transceiver.sender, track, request_keyframe)
            gather_as(transceiver.sender.transport.transport.iceGatherer._connection, IceOptions(loopback=True))
        await self._connection.setLocalDescription(await self._connection.createOffer())
        answer = self._exchange(self._connection.localDescription.sdp)
        try:
            await self._connection.setRemoteDescription(RTCSessionDescription(usable_candidates(answer), "answer"))
        except Exception as error:
            raise PublishingFailed(Failure("the server's answer is no SDP that fits the offer", True)) from error
        try:
            async with asyncio.timeout(self._order.stall_seconds):
                await self._connected.wait()
        except TimeoutError:
            raise PublishingFailed(Failure("the media connection did not come about (ICE, DTLS)")) from None
        if self._gone.is_set():
            raise PublishingFailed(Failure("the media connection did not come about (ICE, DTLS)"))

    async def _wait(self) -> None:
        ends = [asyncio.ensure_future(event.wait()) for event in (self._over, self._gone)]
        await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        for end in ends:
            end.cancel()
        if not self._over.is_set():
            self._resource = ""
            raise PublishingFailed(Failure("the server ended the connection"))
        await asyncio.sleep(LINGER_SECONDS)

    def _state_changed(self) -> None:
        state = self._connection.connectionState
        if state in ("failed", "closed"):
            self._gone.set()
        if state in ("connected", "failed", "closed"):
            self._connected.set()

    def _track_ended(self, tracks: set[PacketTrack], track: PacketTrack) -> None:
        tracks.discard(track)
        if not tracks:
            self._over.set()

    def _exchange(self, offer: str) -> str:
        try:
            status, body = self._request(self._order.url, "POST", self._order.stall_seconds, offer.encode())
        except urllib.error.HTTPError as error:
            with error:
                text = f"{error.code} {_phrase(error.code)}"
            if error.code in (408, 429) or error.code >= 500:
                raise PublishingFailed(Failure(f"the server is in trouble: HTTP {text}")) from None
            raise PublishingFailed(Failure(f"the server refused to publish: HTTP {text}", True)) from None
        except urllib.error.URLError as error:
            why = error.reason if isinstance(error.reason, OSError) else error
            raise PublishingFailed(Failure(f"the server cannot be reached: {reason(why)}")) from None
        except Exception as error:  # what is no HTTP
            raise PublishingFailed(Failure(f"the server cannot be reached: {reason(error)}")) from None
        answer = body.decode("utf-8", "replace")
        if status != HTTPStatus.CREATED or not answer.startswith("v="):
            raise PublishingFailed(Failure("there is no WHIP server at this URL", True))
        return answer

    def _request(self, url: str, method: str, seconds: float, body: bytes | None = None) -> tuple[int, bytes]:
        # Blocking: there is nothing else to do meanwhile.
        request = urllib.request.Request(url, body, method=method)
        if body is not None:
            request.add_header("Content-Type", "application/sdp")
        if self._order.token:
            request.add_header("Authorization", f"Bearer {self._order.token}")
        with within(seconds), _OPENER.open(request, timeout=seconds) as response:
            location = response.headers.get("Location")
            if method == "POST" and location:
                resource = urljoin(url, location)
                if urlsplit(resource)[:2] == urlsplit(url)[:2]:  # this server was allowed, not whichever it names
                    self._resource = resource
            return response.status, response.read(MAX_ANSWER)


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    """The caller's server was allowed, not whichever it names."""

    def redirect_request(self, *_: Any) -> None:
        return None


_OPENER = urllib.request.build_opener(_NoRedirects)


def _phrase(status: int) -> str:
    try:
        return HTTPStatus(status).phrase
    except ValueError:
        return ""
