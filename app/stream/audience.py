"""Who watches a stream: viewers over HTTP and over WebRTC, and servers to which it is pushed."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack

from app.config import Settings
from app.errors import NotFound
from app.stream import whep
from app.stream.broadcast import Broadcast
from app.stream.container import FORMATS, Format
from app.stream.encoder import AacEncoder, OpusEncoder, VideoEncoder
from app.stream.ice import IceOptions
from app.stream.mux import LiveMuxer
from app.stream.packet import Packet
from app.stream.push.push import PushReport
from app.stream.push.pushes import Pushes
from app.stream.seats import Seats

JOIN_SECONDS = 0.5
"""How long a viewer who wakes a sleeping stream waits for its first picture before getting the header."""
SOUND_ONLY_SECONDS = 0.3
"""A WebRTC viewer that takes no pictures so long after it connected wants sound only."""


class Audience:
    """The viewers of one stream. All calls on the event loop, except `picture_published`.

    Args:
        broadcast: what they watch.
        video, aac, opus: the encoders its packets are from.
        settings: of the service.
        seats: for all viewers of the stream.
        webrtc_seats: for the WebRTC viewers of all streams.
        push_seats: for the pushes of all streams.
        on_change: somebody has connected or gone.
        on_push: the state of a push has changed.
        idle_over_webrtc: WebRTC viewers get the idle pictures, too.

    Attributes:
        arrived: somebody has been connected, now or earlier.
        pushes: the servers to which the stream is pushed.
    """

    def __init__(
        self,
        broadcast: Broadcast[Packet],
        video: VideoEncoder,
        aac: AacEncoder,
        opus: OpusEncoder,
        settings: Settings,
        seats: Seats,
        webrtc_seats: Seats,
        push_seats: Seats,
        on_change: Callable[[], None],
        on_push: Callable[[PushReport], None],
        *,
        idle_over_webrtc: bool,
    ) -> None:
        self.arrived = False
        self.pushes = Pushes(broadcast, video, aac, opus, settings.push, push_seats, self._push_changed)
        self._idle_over_webrtc = idle_over_webrtc
        self._broadcast = broadcast
        self._video = video
        self._settings = settings
        self._seats = seats
        self._webrtc_seats = webrtc_seats
        self._on_change = on_change
        self._on_push = on_push
        self._loop = asyncio.get_running_loop()
        self._watching: dict[Format, int] = dict.fromkeys(FORMATS, 0)
        self._muxers = {
            format: LiveMuxer(format, broadcast, video, aac, queue_seconds=settings.stream.queue_seconds)
            for format in FORMATS
        }
        self._peers: dict[str, whep.WhepViewer] = {}
        self._receiving: set[str] = set()  # those of them who get what is published from now on
        self._empty = asyncio.Event()  # no WebRTC viewers
        self._fresh = asyncio.Event()  # a picture to start from has been published since the stream last slept

    @property
    def needs_aac(self) -> bool:
        """Somebody connected hears AAC."""
        return any(self._watching.values()) or self.pushes.count()["rtmp"] > 0

    @property
    def needs_opus(self) -> bool:
        """Somebody connected hears Opus."""
        return bool(self._receiving) or self.pushes.count()["whip"] > 0

    @property
    def present(self) -> bool:
        """Somebody is connected."""
        return self.needs_aac or self.needs_opus

    @property
    def expected(self) -> bool:
        """Somebody is connected or about to be."""
        return self.present or bool(self._peers) or self.pushes.expected

    def count(self) -> dict[str, int]:
        """Who is connected, by transport."""
        over_http = {str(format): viewers for format, viewers in self._watching.items()}
        return {"whep": len(self._receiving), **over_http, **self.pushes.count()}

    def watch(self, format: Format) -> AsyncIterator[bytes]:
        """A viewer over HTTP, from the first iteration until this generator is closed.

        Raises:
            OverCapacity: no seat is free, now or when the iteration begins.
        """
        self._seats.check()
        return self._watch(format)

    async def _watch(self, format: Format) -> AsyncIterator[bytes]:
        with self._seats.one():
            self._watching[format] += 1
            try:
                self._joined()
                # Pictures from before the stream slept are no place to start from.
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(JOIN_SECONDS):
                        await self._fresh.wait()
                chunks = self._muxers[format].watch()
                try:
                    async for data in chunks:
                        yield data
                finally:
                    await chunks.aclose()  # type: ignore[attr-defined]
            finally:
                self._watching[format] -= 1
                self._on_change()

    async def answer(self, offer: str) -> whep.WhepViewer:
        """A viewer over WebRTC; connected when its connection is.

        Raises:
            NegotiationFailed: the offer cannot be answered.
            OverCapacity: no seat or no socket is free.
        """
        taken = ExitStack()
        made: list[whep.WhepViewer] = []

        def picture_wanted() -> None:
            self._video.request_keyframe()
            for each in made:
                self._receives(each)

        def left(each: whep.WhepViewer) -> None:
            taken.close()
            self._left(each)

        def connected(each: whep.WhepViewer) -> None:
            self._loop.call_later(SOUND_ONLY_SECONDS, self._receives, each)

        try:
            taken.enter_context(self._seats.one())
            taken.enter_context(self._webrtc_seats.one())
            peer = await whep.answer(
                offer,
                self._broadcast,
                request_keyframe=picture_wanted,
                on_connected=connected,
                on_closed=left,
                idle=self._idle_over_webrtc,
                ice=IceOptions.of(self._settings.webrtc),
            )
        except BaseException:
            taken.close()
            raise
        made.append(peer)
        if not peer.closed:
            self._peers[peer.id] = peer
            self._empty.clear()
            self._on_change()
        return peer

    def peer(self, viewer: str) -> whep.WhepViewer:
        """A WebRTC viewer.

        Raises:
            NotFound: no such viewer.
        """
        peer = self._peers.get(viewer)
        if peer is None:
            raise NotFound(f"no viewer {viewer}")
        return peer

    async def close(self, grace: float = 0.0) -> None:
        """Disconnect all but those over HTTP, who end with the broadcast, after what is queued for them.

        Args:
            grace: seconds in which they may play out; they go by themselves when the broadcast is closed.
        """
        await asyncio.gather(self._close_peers(grace), self.pushes.close(grace))

    async def _close_peers(self, grace: float) -> None:
        if self._peers and grace:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(grace):
                    await self._empty.wait()
        await asyncio.gather(*(peer.close() for peer in list(self._peers.values())), return_exceptions=True)

    def picture_published(self) -> None:
        """Decoding can start at what was just published. From any thread."""
        if not self._fresh.is_set():
            with contextlib.suppress(RuntimeError):  # the event loop is gone
                self._loop.call_soon_threadsafe(self._fresh.set)

    def slept(self) -> None:
        """No pictures will be published for a while."""
        self._fresh.clear()

    def _joined(self) -> None:
        self.arrived = True
        self._on_change()

    def _receives(self, peer: whep.WhepViewer) -> None:
        # Negotiating and connecting take a while, and what is published meanwhile is lost to the viewer. It counts as
        # arrived when its track asks for the picture to begin with, which it does as soon as it can send.
        if peer.id in self._peers and peer.id not in self._receiving:
            self._receiving.add(peer.id)
            self._joined()

    def _push_changed(self, push: PushReport) -> None:
        self._on_push(push)
        if push.state == "live":
            self._joined()
        else:
            self._on_change()

    def _left(self, peer: whep.WhepViewer) -> None:
        self._peers.pop(peer.id, None)
        self._receiving.discard(peer.id)
        if not self._peers:
            self._empty.set()
        self._on_change()
