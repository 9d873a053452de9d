"""A stream on its way to another server, which shows it to viewers of its own.

The work is done in a process, because a server can let it wait for ever; when that has ended before the stream, another
one is started after a while. A push reads from a bounded queue like every viewer, so its trouble is nobody else's.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Literal

from app.config import PushSettings
from app.stream.broadcast import Broadcast
from app.stream.container import header
from app.stream.encoder import AacEncoder, OpusEncoder, VideoEncoder
from app.stream.packet import Packet
from app.stream.push.pipe import PublishOrder
from app.stream.push.publishing import END_SECONDS, Broken, Publishing
from app.stream.push.target import PushKind, PushTarget
from app.stream.seats import Seats

MAX_REFUSALS = 3
"""A server that refuses a push so often, and never let it be published, will not be asked again."""

PushState = Literal["connecting", "live", "retrying", "failed", "ended"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class PushReport:
    """A push as the outside sees it: `target` without credentials, the last `error` or "", how often it was retried."""

    id: str
    kind: PushKind
    target: str
    state: PushState
    error: str
    retries: int


class Push:
    """See the module. On one event loop; works from its making until `close`, its failure or the end of the source.

    Args:
        target: where to.
        source: what is pushed: "video" and the kind of `sound`.
        video, sound: the encoders its packets are from: AAC for RTMP, Opus for WHIP.
        settings: how patient it is.
        seats: one is taken until the push is over.
        request_keyframe: called when a key frame is needed.
        on_change: called when the state has changed.

    Attributes:
        id: names it in its stream.
        target: as given.
        state: "connecting", "live" (the server takes it), "retrying" (after a failure), "failed" (given up) or "ended".
    """

    def __init__(
        self,
        target: PushTarget,
        source: Broadcast[Packet],
        video: VideoEncoder,
        sound: AacEncoder | OpusEncoder,
        settings: PushSettings,
        seats: Seats,
        *,
        request_keyframe: Callable[[], None],
        on_change: Callable[[Push], None],
    ) -> None:
        taken = ExitStack()
        taken.enter_context(seats.one())
        self.id = secrets.token_urlsafe(6)
        self.target = target
        self.state: PushState = "connecting"
        self._error = ""
        self._retries = 0
        self._source = source
        self._settings = settings
        self._on_change = on_change
        self._closing = False
        head, _ = header("mp4", {"movflags": "empty_moov"}, [video.template, sound.template])
        order = PublishOrder(target.kind, target.url, target.token, head, video.extradata, settings.stall_seconds)
        self._publishing = Publishing(order, source, {"video", sound.kind}, request_keyframe)
        self._task = asyncio.create_task(self._run(), name=f"push-{self.id}")
        self._task.add_done_callback(lambda _: taken.close())  # also of a task that is cancelled before it runs

    @property
    def over(self) -> bool:
        """Nothing more will come of it."""
        return self.state in ("failed", "ended")

    def report(self) -> PushReport:
        """The present state."""
        return PushReport(self.id, self.target.kind, self.target.shown, self.state, self._error, self._retries)

    async def close(self, grace: float = 0.0) -> None:
        """End the push: the server is told so, if it listens. Leaves neither task nor process. Idempotent.

        Args:
            grace: seconds in which it may play out what is queued.
        """
        self._closing = True
        if self.state == "live":
            if grace and self._source.closed:
                await asyncio.wait({self._task}, timeout=grace)
            self._publishing.finish()
            await asyncio.wait({self._task}, timeout=END_SECONDS)
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        if not self.over:
            self._set("ended")

    async def _run(self) -> None:
        try:
            await self._publish_until_over()
        except Exception as error:
            _log.exception("a push failed")
            self._set("failed", type(error).__name__)

    async def _publish_until_over(self) -> None:
        settings = self._settings
        was_live, failures, refusals = False, 0, 0
        down_since = time.monotonic()
        while True:
            began = time.monotonic()
            try:
                await self._publishing.run(lambda: self._set("live"))
                return self._set("ended")
            except Broken as error:
                refused = error.refused
                message = ": ".join(filter(None, [error.message, self.target.hide(error.detail)]))
            now = time.monotonic()
            if self._closing or self._source.closed:
                return self._set("ended", message)
            if self.state == "live":
                was_live = True
                down_since = now
                if now - began >= settings.retry_max_seconds:  # one that breaks at once again and again is not well
                    failures = 0
            failures += 1
            refusals = refusals + 1 if refused else 0
            if (refusals >= MAX_REFUSALS and not was_live) or now - down_since >= settings.give_up_seconds:
                return self._set("failed", message)
            self._set("retrying", message)
            await asyncio.sleep(min(settings.retry_seconds * 2.0 ** (failures - 1), settings.retry_max_seconds))
            self._retries += 1

    def _set(self, state: PushState, error: str = "") -> None:
        if (state, error) == (self.state, self._error):
            return
        changed = state != self.state
        self.state, self._error = state, error
        if changed:
            _log.info("push to %s: %s%s", self.target.shown, state, f" ({error})" if error else "")
        self._on_change(self)
