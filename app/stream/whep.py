"""WebRTC viewers by WHEP (draft-ietf-wish-whep-03): an SDP offer in, an answer out, then shared packets over RTP."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.sdp import SessionDescription, candidate_from_sdp

from app.errors import IceRestartRefused, MaryError, NegotiationFailed, OverCapacity
from app.stream.broadcast import Broadcast
from app.stream.ice import MAX_CANDIDATES, IceOptions, gather_as, usable, usable_candidates
from app.stream.packet import Packet
from app.stream.rtp import KINDS, PacketTrack, WallClock, attach, codecs
from app.stream.trickle import Section

logger = logging.getLogger(__name__)

LINGER_SECONDS = 0.3  # after the stream's last packet the connection stays so long, for the viewer to play out

_CODECS = {"video": "video/h264", "audio": "audio/opus"}
_NAMES = {"video": "H.264", "audio": "Opus"}


class WhepViewer:
    """A WebRTC viewer, made by `answer`.

    Attributes:
        id: 128 random bits, URL-safe.
        etag: names its ICE session, which is the same until it ends: an entity-tag with its quotes.
        answer: the SDP answer.
        connected: media could flow.
        closed: it is over.
    """

    def __init__(
        self,
        connection: RTCPeerConnection,
        offer: SessionDescription,
        transports: Sequence[Any],
        on_connected: Callable[[WhepViewer], None] | None,
        on_closed: Callable[[WhepViewer], None] | None,
        connect_seconds: float,
    ) -> None:
        self.id = secrets.token_urlsafe(16)
        self.etag = f'"{secrets.token_hex(8)}"'
        self.answer = ""
        self.connected = False
        self.closed = False
        self._connection = connection
        self._offer = offer
        self._candidates = {
            (media.rtp.muxId, each.ip, each.port) for media in offer.media for each in media.ice_candidates
        }
        self._transports = transports
        self._on_connected = on_connected
        self._on_closed = on_closed
        self._loop = asyncio.get_running_loop()
        self._closing: asyncio.Task[None] | None = None
        self._timer = self._loop.call_later(connect_seconds, self._begin_closing)
        connection.on("connectionstatechange", self._state_changed)

    async def trickle(self, sections: Sequence[Section]) -> None:
        """Take candidates that the viewer found after its offer. Useless ones are passed over in silence.

        Raises:
            NegotiationFailed: a section is not one of the offer's.
            IceRestartRefused: the credentials are not those of the offer.
        """
        offered = {media.rtp.muxId: media for media in self._offer.media}
        for section in sections:
            media = offered.get(section.mid)
            if media is None:
                raise NegotiationFailed(f"the offer has no section {section.mid[:40]!r}")
            ice = media.ice
            assert ice is not None  # or the offer would not have been taken
            if (section.ufrag, section.password) != (ice.usernameFragment, ice.password):
                raise IceRestartRefused(
                    "other ICE credentials than the offer's would restart ICE, which is not supported",
                    advice="Keep the connection as long as it works; then DELETE it and send a new offer.",
                )
        for candidate in (each for section in sections for each in self._fresh(section)):
            await self._connection.addIceCandidate(candidate)

    def _fresh(self, section: Section) -> Iterator[Any]:
        for value in section.candidates:
            if len(self._candidates) < MAX_CANDIDATES and usable(value.split()):
                candidate = candidate_from_sdp(value)
                candidate.sdpMid = section.mid
                key = (section.mid, candidate.ip, candidate.port)
                if key not in self._candidates:
                    self._candidates.add(key)
                    yield candidate

    async def close(self) -> None:
        """End the connection. May be called more than once."""
        await asyncio.shield(self._begin_closing())

    def _state_changed(self) -> None:
        state = self._connection.connectionState
        if state == "connected" and not self.connected and self._closing is None:
            self.connected = True
            self._timer.cancel()
            if self._on_connected is not None:
                self._on_connected(self)
        elif state in ("failed", "closed"):
            self._begin_closing()

    def _track_ended(self) -> None:
        if self._closing is None:
            self._timer.cancel()
            self._timer = self._loop.call_later(LINGER_SECONDS, self._begin_closing)

    def _begin_closing(self) -> asyncio.Task[None]:
        if self._closing is None:
            self._closing = self._loop.create_task(self._close())
        return self._closing

    async def _close(self) -> None:
        self._timer.cancel()
        try:
            await _close(self._connection, self._transports)
        finally:
            self.closed = True
            if self._on_closed is not None:
                self._on_closed(self)


async def answer(
    offer: str,
    source: Broadcast[Packet],
    *,
    request_keyframe: Callable[[], None],
    on_connected: Callable[[WhepViewer], None] | None = None,
    on_closed: Callable[[WhepViewer], None] | None = None,
    ice: IceOptions | None = None,
    connect_seconds: float = 15.0,
    idle: bool = True,
) -> WhepViewer:
    """Answer an offer to receive `source`. Every callback is called on the event loop.

    Args:
        offer: SDP with a video or an audio section, or one of each, that wants to receive H.264 or Opus.
        source: where "video" and "opus" packets come from; when it is closed, so is the viewer.
        request_keyframe: called when the viewer starts, was too slow or has lost pictures. Requests are not coalesced
            (`VideoEncoder.request_keyframe` does that).
        on_connected: called once if the viewer connects.
        on_closed: called exactly once, however the viewer ends.
        ice: what the answer offers to connect to; None: the addresses of the network interfaces.
        connect_seconds: a viewer that has not connected by then is closed.
        idle: see `PacketTrack`.

    Raises:
        NegotiationFailed: the offer is no SDP, or wants nothing that can be sent.
        OverCapacity: no socket can be opened.
    """
    ice = ice or IceOptions()
    offer = usable_candidates(offer)
    description, kinds = _wanted(offer)
    # Also an empty list has to be said: without one aiortc asks a public STUN server, and waits for it.
    connection = RTCPeerConnection(RTCConfiguration(iceServers=list(ice.servers)))
    clock = WallClock()
    tracks: list[PacketTrack] = []
    transports: list[Any] = []
    try:
        # Before the offer is set, or VP8 is negotiated.
        for kind in kinds:
            track = PacketTrack(KINDS[kind], source, clock, request_keyframe, idle=idle)
            transceiver = connection.addTransceiver(track, direction="sendonly")
            transceiver.setCodecPreferences(codecs(kind))
            attach(transceiver.sender, track, request_keyframe)
            transport = transceiver.sender.transport.transport.iceGatherer._connection
            gather_as(transport, ice)
            tracks.append(track)
            transports.append(transport)
        await connection.setRemoteDescription(RTCSessionDescription(offer, "offer"))
        await connection.setLocalDescription(await connection.createAnswer())
        sdp = connection.localDescription.sdp
        if "a=candidate:" not in sdp:  # aioice goes on without the sockets it cannot open
            raise OSError("no UDP socket could be opened")
    except MaryError:
        await _close(connection, transports)
        raise
    except OSError as error:  # the server's trouble, not the offer's
        await _close(connection, transports)
        raise OverCapacity(
            f"no connection can be opened: {error}", advice="Try again when viewers have gone."
        ) from error
    except Exception as error:
        await _close(connection, transports)
        raise NegotiationFailed(
            f"the offer cannot be answered: {error}",
            advice="Offer H.264 constrained baseline with packetization-mode=1, Opus, ICE and DTLS, to be received.",
        ) from error
    except BaseException:
        await _close(connection, transports)
        raise
    viewer = WhepViewer(connection, description, transports, on_connected, on_closed, connect_seconds)
    for track in tracks:
        track.on("ended", viewer._track_ended)
    viewer.answer = _completed(sdp)
    return viewer


def _completed(answer: str) -> str:
    """With what WHEP asks for and aiortc leaves out: that candidates may be trickled, and that RTCP is not separate."""
    session, media = answer.split("m=", 1)
    bundled = "a=group:BUNDLE" in session
    media = media.replace("a=rtcp-mux\r\n", "a=rtcp-mux\r\na=rtcp-mux-only\r\n") if bundled else media
    return f"{session}a=ice-options:trickle\r\nm={media}"


async def _close(connection: RTCPeerConnection, transports: Sequence[Any]) -> None:
    """Close a connection in whatever state, its sockets for certain."""
    try:
        await connection.close()
    except Exception:
        # aiortc stumbles over what a strange offer made of its transports; the sockets belong to aioice.
        logger.debug("a connection did not close cleanly", exc_info=True)
    for transport in transports:
        await transport.close()


def _wanted(offer: str) -> tuple[SessionDescription, list[str]]:
    """The offer, read, and the kinds of media ("video", "audio") that it wants to receive and that can be sent."""
    advice = "Send an SDP offer with recvonly video and audio, as RTCPeerConnection.createOffer makes it."
    try:
        description = SessionDescription.parse(offer)
    except Exception as error:  # aiortc's parser raises whatever its assumptions break with
        raise NegotiationFailed("the offer is not valid SDP", advice=advice) from error
    mids = [each.rtp.muxId for each in description.media]
    bundled = {mid for group in description.group if group.semantic == "BUNDLE" for mid in group.items}
    if len(set(mids)) < len(mids) or not bundled <= set(mids):
        raise NegotiationFailed("the sections of the offer are not named properly (a=mid, a=group)", advice=advice)
    media = [each for each in description.media if each.direction in ("recvonly", "sendrecv")]
    kinds = [each.kind for each in media]
    if not set(kinds) & set(KINDS):
        raise NegotiationFailed("the offer does not ask to receive video or audio", advice=advice)
    if len(media) < len(description.media) or len(set(kinds)) < len(kinds) or not set(kinds) <= set(KINDS):
        raise NegotiationFailed("the offer has more than a video and an audio section to receive", advice=advice)
    if any(each.dtls is None or not each.dtls.fingerprints for each in media):
        raise NegotiationFailed("the offer has no DTLS fingerprint", advice=advice)
    for each in media:
        offered = {codec.mimeType for codec in each.rtp.codecs}
        if _CODECS[each.kind] not in {name.lower() for name in offered}:
            names = ", ".join(sorted(name.partition("/")[2] for name in offered)) or "none"
            raise NegotiationFailed(
                f"{each.kind} is sent as {_NAMES[each.kind]} only, the offer's codecs are: {names}",
                advice=f"Use a browser that plays {_NAMES[each.kind]} over WebRTC.",
            )
    return description, [kind for kind in KINDS if kind in kinds]
