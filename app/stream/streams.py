"""The live streams of the process: made, found, ended when nobody needs them, and counted."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Self

from app.config import Settings
from app.engine.pool import OrderedPool
from app.errors import NotFound, OverCapacity
from app.stream.live import LiveStream, StreamOptions
from app.stream.push.target import PushTarget
from app.stream.seats import Seats
from app.stream.timeline import IdlePhase
from app.stream.timing import LatencyLog
from app.stream.utterance import Narrator

if TYPE_CHECKING:
    from app.engine.avatar import Avatar

REAP_SECONDS = 1.0
KEPT_ENDED = 100
"""Streams remembered after their end; with the oldest its files go."""

_log = logging.getLogger(__name__)


class Streams:
    """An asynchronous context manager: while it is open, idle streams end by themselves; leaving it ends all.

    A stream that has ended is remembered for `stream.keep_seconds`, with its files if it ended by itself, so that its
    viewers learn that it is gone and its videos can be fetched; but no more than `KEPT_ENDED` are.

    Args:
        settings: of the service.
        narrator: checks a text and makes it speech.
        pool: makes the frames; stays the caller's.

    Attributes:
        latency: the last utterances of all streams.
    """

    def __init__(self, settings: Settings, narrator: Narrator, pool: OrderedPool) -> None:
        self.latency = LatencyLog()
        self._settings = settings
        self._narrator = narrator
        self._pool = pool
        self._webrtc_seats = Seats(settings.webrtc.max_viewers, "WebRTC viewers")
        self._push_seats = Seats(settings.push.max, "pushes")
        self._streams: dict[str, LiveStream] = {}
        self._folder = Path(tempfile.mkdtemp(prefix="mary-streams-"))
        self._reaper: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._reaper = asyncio.create_task(self._reap_forever(), name="stream-reaper")
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def create(
        self,
        avatar: Avatar,
        *,
        voice: str,
        options: StreamOptions | None = None,
        phase: IdlePhase | None = None,
        pushes: Sequence[PushTarget] = (),
    ) -> LiveStream:
        """Start a stream (see `LiveStream`) and push it to these targets; on the event loop.

        Raises:
            OverCapacity: `stream.max_streams` are running, or with these more than `push.max` pushes.
        """
        self._push_seats.check(len(pushes))
        if self.running >= self._settings.stream.max_streams:
            raise OverCapacity(
                f"{self._settings.stream.max_streams} streams are running", advice="Try again when one has ended."
            )
        self._forget_oldest()
        folder = Path(tempfile.mkdtemp(dir=self._folder))
        stream = LiveStream(
            avatar,
            voice=voice,
            narrator=self._narrator,
            pool=self._pool,
            settings=self._settings,
            folder=folder,
            latency=self.latency,
            options=options or StreamOptions(),
            phase=phase,
            webrtc_seats=self._webrtc_seats,
            push_seats=self._push_seats,
        )
        self._streams[stream.id] = stream
        for target in pushes:
            stream.push(target)
        return stream

    @property
    def running(self) -> int:
        """Streams that have not ended."""
        return sum(stream.ended_at is None for stream in self._streams.values())

    def get(self, stream: str) -> LiveStream:
        """The stream of this id, which may have ended.

        Raises:
            NotFound: there is none, or it ended too long ago.
        """
        found = self._streams.get(stream)
        if found is None:
            raise NotFound(f"no stream {stream}", advice="It may have ended.")
        return found

    async def end(self, stream: str) -> None:
        """End a stream and delete its files.

        Raises:
            NotFound: as in `get`.
        """
        await self.get(stream).end()

    async def reap(self) -> None:
        """Let idle streams end, delete files that have expired, and forget streams that ended long ago."""
        now = time.monotonic()
        limits = self._settings.stream
        for stream in list(self._streams.values()):
            if stream.idle_since is not None and now - stream.idle_since >= limits.idle_seconds:
                stream.stop()  # nobody waits for it, so one that ends slowly holds up no other
            files_left = stream.expire(limits.keep_seconds)
            ended = stream.ended_at is not None and now - stream.ended_at >= limits.keep_seconds
            if ended and not files_left:
                self._forget(stream)
        self._forget_oldest()

    async def close(self) -> None:
        """End all streams and delete all files. Idempotent."""
        if self._reaper is not None:
            self._reaper.cancel()
            await asyncio.gather(self._reaper, return_exceptions=True)
            self._reaper = None
        await asyncio.gather(*(stream.end() for stream in self._streams.values()))
        self._streams.clear()
        with contextlib.suppress(FileNotFoundError):
            await asyncio.to_thread(shutil.rmtree, self._folder)

    def _forget_oldest(self) -> None:
        ended = [(stream.ended_at, stream) for stream in self._streams.values() if stream.ended_at is not None]
        ended.sort(key=lambda pair: pair[0])
        for _, stream in ended[: max(0, len(ended) - KEPT_ENDED)]:
            self._forget(stream)

    def _forget(self, stream: LiveStream) -> None:
        if self._streams.pop(stream.id, None) is not None:
            shutil.rmtree(stream.folder, ignore_errors=True)

    async def _reap_forever(self) -> None:
        while True:
            await asyncio.sleep(REAP_SECONDS)
            try:
                await self.reap()
            except Exception:
                _log.exception("looking for idle streams failed")
