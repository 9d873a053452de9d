"""Packets to RTP through aiortc: tracks of encoded packets, and the two private places of its sender they need.

aiortc sends an `av.Packet` that a track returns as it is, with `pts` as RTP time. Two things it does not foresee:

* A viewer's request for a key frame (PLI, FIR) sets a flag for aiortc's own encoder. `RTCRtpSender._send_keyframe` is
  replaced by a callback.
* Sender reports, by which a receiver puts sound and picture in step, carry the time at which the last packet happened
  to be sent. Pictures are encoded ahead of their time and sound lags by its packet, so that would shift one against the
  other. `RTCRtpSender._send_rtcp` is wrapped to report the stream's clock for both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from aiortc import MediaStreamTrack, RTCRtpSender
from aiortc.clock import current_ntp_time
from aiortc.mediastreams import MediaStreamError
from aiortc.rtp import RtcpSrPacket

from app.stream.broadcast import Broadcast, Subscription
from app.stream.packet import Kind, Packet

KINDS: dict[str, Kind] = {"video": "video", "audio": "opus"}
"""Kinds of media of WebRTC, and the packets that are sent as each."""
PROFILES = ("42e01f", "42001f")
"""Of H.264, the one that is sent first: constrained baseline, which is decodable as either."""

NTP_SECOND = 1 << 32  # NTP time stamps are 32.32 fixed point


class WallClock:
    """The stream's clock as NTP time, the same for all tracks of a viewer: set by the first packet that is sent."""

    def __init__(self, now: Callable[[], int] = current_ntp_time) -> None:
        self._now = now
        self._zero: int | None = None

    def ntp(self, seconds: float) -> int:
        """NTP time (32.32 fixed point) of `seconds` on the stream's clock."""
        elapsed = round(seconds * NTP_SECOND)
        if self._zero is None:
            self._zero = self._now() - elapsed
        return self._zero + elapsed


class PacketTrack(MediaStreamTrack):
    """One kind of packets of a stream, from when the connection stands: nothing waits for a viewer before that.

    Pictures begin with a key frame, which is asked for; so they do after a viewer was too slow.

    Args:
        kind: which packets.
        source: where they come from.
        clock: of all tracks of the viewer.
        on_lost: called when a key frame is needed to go on.
        idle: also send the pictures in which nobody speaks; speech begins with a key frame, so they can be left out.
    """

    def __init__(
        self,
        kind: Kind,
        source: Broadcast[Packet],
        clock: WallClock,
        on_lost: Callable[[], None],
        *,
        idle: bool = True,
    ) -> None:
        super().__init__()
        self.kind = "video" if kind == "video" else "audio"
        self.sent: Packet | None = None  # the last one
        self._kind: Kind = kind
        self._source = source
        self._clock = clock
        self._on_lost = on_lost
        self._subscription: Subscription[Packet] | None = None
        self._cuts = 0
        self._idle = idle
        self._left_out = False  # pictures, since the last one sent

    async def recv(self) -> Any:
        """The next packet as `av.Packet`. Raises MediaStreamError at the end."""
        if self.readyState != "live":
            raise MediaStreamError
        if self._subscription is None:
            self._subscription = self._source.subscribe({self._kind}, backlog=False)
            self._lost()
        try:
            packet = await self._next(self._subscription)
        except StopAsyncIteration:
            self.stop()
            raise MediaStreamError from None
        if self._subscription.cuts != self._cuts:
            self._cuts = self._subscription.cuts
            self._lost()
        self.sent = packet
        self._clock.ntp(packet.seconds)
        return packet.to_av()

    async def _next(self, subscription: Subscription[Packet]) -> Packet:
        async for packet in subscription:
            if packet.idle and not self._idle:
                self._left_out = True
            elif not self._left_out or packet.starts:
                self._left_out = False
                return packet
        raise StopAsyncIteration

    def report_time(self) -> int | None:
        """NTP time of the last packet sent, None before the first."""
        return None if self.sent is None else self._clock.ntp(self.sent.seconds)

    def stop(self) -> None:
        """End the track."""
        if self._subscription is not None:
            self._subscription.close()
        super().stop()

    def _lost(self) -> None:
        if self._kind == "video":
            self._on_lost()


def codecs(kind: str, profiles: Sequence[str] = PROFILES) -> list[Any]:
    """What can be sent as `kind`, one of `KINDS`, in the order of preference: for `setCodecPreferences`."""
    known = RTCRtpSender.getCapabilities(kind).codecs
    if kind == "audio":
        return [codec for codec in known if codec.mimeType.lower() == "audio/opus"]
    h264 = [
        codec
        for profile in profiles
        for codec in known
        if codec.mimeType.lower() == "video/h264" and codec.parameters.get("profile-level-id") == profile
    ]
    return h264 + [codec for codec in known if codec.mimeType.lower() == "video/rtx"]


def attach(sender: Any, track: PacketTrack, on_keyframe_request: Callable[[], None]) -> None:
    """Change an `RTCRtpSender` as the module's text says."""
    send_rtcp = sender._send_rtcp

    async def send_reports(packets: list[Any]) -> None:
        time = track.report_time()
        for packet in packets:
            if isinstance(packet, RtcpSrPacket):
                if time is None:
                    return  # nothing has been sent, so there is no time to report
                packet.sender_info.ntp_timestamp = time
        await send_rtcp(packets)

    sender._send_keyframe = on_keyframe_request
    sender._send_rtcp = send_reports
