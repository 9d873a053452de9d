"""The pushes of one stream."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from app.config import PushSettings
from app.errors import NotFound
from app.stream.broadcast import Broadcast
from app.stream.encoder import AacEncoder, OpusEncoder, VideoEncoder
from app.stream.packet import Packet
from app.stream.push.push import Push, PushReport
from app.stream.push.target import PushTarget
from app.stream.seats import Seats

KEPT_OVER = 16
"""Pushes remembered after their end."""


class Pushes:
    """Begun, found, ended and counted. All calls on the event loop.

    Args:
        source: what is pushed.
        video, aac, opus: the encoders its packets are from.
        settings: of all pushes.
        seats: for the pushes of all streams.
        on_change: the state of one has changed.
    """

    def __init__(
        self,
        source: Broadcast[Packet],
        video: VideoEncoder,
        aac: AacEncoder,
        opus: OpusEncoder,
        settings: PushSettings,
        seats: Seats,
        on_change: Callable[[PushReport], None],
    ) -> None:
        self._source = source
        self._video = video
        self._aac = aac
        self._opus = opus
        self._settings = settings
        self._seats = seats
        self._on_change = on_change
        self._pushes: dict[str, Push] = {}

    @property
    def expected(self) -> bool:
        """A push is live or tries to be."""
        return any(not push.over for push in self._pushes.values())

    @property
    def live(self) -> bool:
        """A server takes the stream."""
        return any(self.count().values())

    def count(self) -> dict[str, int]:
        """Live pushes by kind: rtmp, whip."""
        counts = {"rtmp": 0, "whip": 0}
        for push in self._pushes.values():
            counts[push.target.kind] += push.state == "live"
        return counts

    def start(self, target: PushTarget) -> PushReport:
        """Begin to push; returns at once.

        Raises:
            OverCapacity: `push.max` pushes are running.
        """
        over = [each for each in self._pushes.values() if each.over]
        for each in over[: max(0, len(over) - KEPT_OVER)]:
            del self._pushes[each.id]
        push = Push(
            target,
            self._source,
            self._video,
            self._aac if target.kind == "rtmp" else self._opus,
            self._settings,
            self._seats,
            request_keyframe=self._video.request_keyframe,
            on_change=lambda push: self._on_change(push.report()),
        )
        self._pushes[push.id] = push
        return push.report()

    async def end(self, push: str) -> None:
        """End a push; it is still reported.

        Raises:
            NotFound: there is none of this id.
        """
        found = self._pushes.get(push)
        if found is None:
            raise NotFound(f"no push {push}")
        await found.close()

    def reports(self) -> tuple[PushReport, ...]:
        """All, the oldest first; some that are over are forgotten."""
        return tuple(push.report() for push in self._pushes.values())

    async def close(self, grace: float = 0.0) -> None:
        """End all; see `Push.close`."""
        await asyncio.gather(*(push.close(grace) for push in self._pushes.values()))
