"""One live stream: things to say, one after the other, on one clock, encoded once for any number of viewers."""

from __future__ import annotations

import asyncio
import logging
import secrets
import time
from collections.abc import AsyncIterator, Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.config import Settings
from app.engine.pool import OrderedPool
from app.errors import Gone, NotFound
from app.stream import captions
from app.stream.captions import Captions
from app.stream.clock import FPS
from app.stream.container import FORMATS, Format
from app.stream.events import EVENT_NAMES, Event, EventBoard
from app.stream.production import Production, StreamOptions, StreamState
from app.stream.push.push import PushReport
from app.stream.push.target import PushTarget
from app.stream.seats import Seats
from app.stream.timeline import IdlePhase
from app.stream.timing import LatencyLog, LoggedUtterance
from app.stream.utterance import Narrator, Reading, Script, Utterance, UtteranceReport
from app.stream.utterances import Utterances
from app.stream.whep import WhepViewer

if TYPE_CHECKING:
    from app.engine.avatar import Avatar

__all__ = ["LiveStream", "StreamOptions", "StreamReport"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class StreamReport:
    """A stream as the outside sees it. `viewers` by transport; frames `rendered` (encoded) and `dropped` (too late)."""

    id: str
    state: StreamState
    avatar: str
    trajectory: str
    renderer: str
    voice: str
    viewers: dict[str, int]
    pushes: tuple[PushReport, ...]
    utterances: tuple[UtteranceReport, ...]
    rendered: int
    dropped: int


class LiveStream:
    """See the module. All calls on the event loop it was created on.

    With nobody watching and nothing to say it does no work. A viewer can slow down neither the clock nor another
    viewer: all of them read from bounded queues. After its end nothing is left of it but what it said: a report and
    the finished files.

    Args:
        avatar: who speaks.
        voice: default voice of what is said.
        narrator: checks a text and makes it speech.
        pool: makes the frames.
        settings: of the service.
        folder: for finished files; must exist.
        latency: told about every utterance.
        options: see there.
        phase: where the page's idle clip is, if it shows one.
        webrtc_seats: for the WebRTC viewers of all streams; by default this one has its own.
        push_seats: for the pushes of all streams; by default this one has its own.

    Attributes:
        id: 128 random bits.
        voice, folder, options: as given.
        ended_at: when it ended, seconds on the monotonic clock, or None.
    """

    def __init__(
        self,
        avatar: Avatar,
        *,
        voice: str,
        narrator: Narrator,
        pool: OrderedPool,
        settings: Settings,
        folder: Path,
        latency: LatencyLog,
        options: StreamOptions | None = None,
        phase: IdlePhase | None = None,
        webrtc_seats: Seats | None = None,
        push_seats: Seats | None = None,
    ) -> None:
        self.id = secrets.token_urlsafe(16)
        self.voice = voice
        self.folder = folder
        self.options = options or StreamOptions()
        self.ended_at: float | None = None
        self._narrator = narrator
        self._latency = latency
        self._looks = (avatar.manifest.id, avatar.model.name, avatar.renderer)
        self._frames = (0, 0)  # rendered and dropped, at the end
        self._pushes: tuple[PushReport, ...] = ()  # at the end
        self._said = Utterances()
        self._captions = Captions()
        seats = Seats(settings.stream.max_viewers, "viewers of this stream")
        self._events = EventBoard(seats)
        self._production: Production | None = Production(
            avatar,
            self._said,
            self._events,
            self._captions,
            pool=pool,
            settings=settings,
            folder=folder,
            options=self.options,
            phase=phase,
            seats=seats,
            webrtc_seats=webrtc_seats or Seats(settings.webrtc.max_viewers, "WebRTC viewers"),
            push_seats=push_seats or Seats(settings.push.max, "pushes"),
        )
        self._ending = False
        loop = asyncio.get_running_loop()
        self._life = loop.create_task(self._live(self._production), name=f"stream-{self.id[:6]}")

    @property
    def state(self) -> StreamState:
        """What it does: "waiting" for its first viewer or for sound, "speaking", "idle", or it has "ended"."""
        return "ended" if self._production is None else self._production.state

    @property
    def idle_since(self) -> float | None:
        """Since when nobody watches and there is nothing to say, seconds on the monotonic clock, or None."""
        return None if self._production is None else self._production.idle_since

    @property
    def avatar(self) -> Avatar:
        """Who speaks.

        Raises:
            Gone: the stream has ended.
        """
        return self._living().avatar

    def say(
        self,
        text: str,
        *,
        interrupt: bool = False,
        reading: Reading | None = None,
        phase: IdlePhase | None = None,
        face: Avatar | None = None,
    ) -> Utterance:
        """Queue a text; returns at once, the work happens in the background.

        Args:
            text: what to say.
            interrupt: cut short what is being said and forget what is queued.
            reading: how; by default with the stream's voice.
            phase: where the page's idle clip is, if it shows one.
            face: the avatar as it is to say this, moved or drawn by something else than usual.

        Raises:
            Gone: the stream has ended.
            NothingToSay, InputError, NotFound: what the narrator says about the text or how to read it.
            OverCapacity: too much is queued.
        """
        self._living()
        reading = reading or Reading()
        script = self._narrator(text, replace(reading, voice=reading.voice or self.voice))
        return self.speak(script, len(text), interrupt=interrupt, phase=phase, face=face)

    def speak(
        self,
        script: Script,
        characters: int,
        *,
        interrupt: bool = False,
        phase: IdlePhase | None = None,
        face: Avatar | None = None,
    ) -> Utterance:
        """Queue speech, however it is made; returns at once, the work happens in the background.

        Args:
            script: the speech, which may still be in the making.
            characters: length of its text, as far as it is known.
            interrupt, phase, face: as in `say`.

        Raises:
            Gone: the stream has ended.
            OverCapacity: too much is queued.
        """
        production = self._living()
        utterance = Utterance(characters, script.unread, script.guessed, phase, face=face)
        production.say(script, utterance, interrupt=interrupt)
        self._latency.add(LoggedUtterance(self.id, utterance.id, utterance.characters, utterance.timings))
        return utterance

    def check_living(self) -> None:
        """Raise Gone if it has ended, before work is done for it."""
        self._living()

    def interrupt(self) -> None:
        """Fall silent within two frames, close the mouth, and forget what is queued.

        Raises:
            Gone: the stream has ended.
        """
        self._living().program.interrupt(time.monotonic())

    def shown(self, utterance: str, milliseconds: float) -> None:
        """The browser showed the first frame so long after the request.

        Raises:
            NotFound: no such utterance.
        """
        self._said.find(utterance).timings.set("shown", milliseconds)

    def watch(self, format: Format) -> AsyncIterator[bytes]:
        """The stream in a container format; a viewer as long as it is iterated. Close the iterator.

        Raises:
            Gone: the stream has ended.
            OverCapacity: it has too many viewers, now or when the iteration begins.
        """
        return self._living().audience.watch(format)

    async def whep(self, offer: str) -> WhepViewer:
        """Answer a WebRTC offer.

        Raises:
            Gone: the stream has ended.
            NegotiationFailed: the offer cannot be answered.
            OverCapacity: there are too many viewers.
        """
        peer = await self._living().audience.answer(offer)
        if self._ending:  # meanwhile
            await peer.close()
            self._living()
        return peer

    def peer(self, viewer: str) -> WhepViewer:
        """The WebRTC viewer of that id, as long as it is connected or connecting.

        Raises:
            NotFound: no such viewer.
        """
        if self._production is None:
            raise NotFound(f"no viewer {viewer}")
        return self._production.audience.peer(viewer)

    def push(self, target: PushTarget) -> PushReport:
        """Begin to push the stream to a server; returns at once.

        Raises:
            Gone: the stream has ended.
            OverCapacity: there are too many pushes.
        """
        return self._living().audience.pushes.start(target)

    async def end_push(self, push: str) -> None:
        """End a push.

        Raises:
            NotFound: no such push.
        """
        if self._production is None:
            raise NotFound(f"no push {push}")
        await self._production.audience.pushes.end(push)

    def events(self, names: Collection[str] = EVENT_NAMES) -> AsyncIterator[Event]:
        """What happens from the first iteration on; ends with the stream.

        First come the present state and, if something is being said, its `speak_started` once more.

        Args:
            names: of the events wanted.

        Raises:
            OverCapacity: the stream has too many viewers, now or when the iteration begins.
        """
        return self._events.listen(self._present, names)

    def captions(self, utterance: str | None = None) -> str:
        """What was said so far as a WebVTT document, on the stream's clock or on that of an utterance's video.

        Raises:
            NotFound: no such utterance.
        """
        if utterance is None:
            return captions.document(self._captions.words())
        start = self._said.find(utterance).start or 0
        return captions.document(self._captions.words(utterance), start / FPS)

    def live_captions(self) -> AsyncIterator[str]:
        """What was said so far as a WebVTT document that goes on, phrase by phrase, until the stream ends.

        Raises:
            OverCapacity: the stream has too many viewers, now or when the iteration begins.
        """
        return self._captions.follow(self.events(("state", "word", "speak_ended")))

    def report(self) -> StreamReport:
        """The present state."""
        production = self._production
        rendered, dropped = (production.rendered, production.dropped) if production is not None else self._frames
        return StreamReport(
            self.id,
            self.state,
            *self._looks,
            self.voice,
            production.audience.count()
            if production is not None
            else dict.fromkeys(("whep", *FORMATS, "rtmp", "whip"), 0),
            production.audience.pushes.reports() if production is not None else self._pushes,
            self._said.reports(),
            rendered,
            dropped,
        )

    def video(self, utterance: str | None = None) -> Path:
        """The finished file of an utterance, by default of the last.

        Raises:
            NotFound: no such utterance, or it has no file (any more).
            NotReady: it is still being spoken or written.
        """
        return self._said.video(utterance)

    def stop(self) -> None:
        """Begin to end; `say` and viewers are refused from now on. See `end`."""
        self._ending = True
        if self._production is not None:
            self._production.stop()

    async def end(self, *, keep_files: bool = False) -> None:
        """End the stream: viewers get what is queued for them and then the end.

        Leaves no task, and no thread except one in which a speech engine is in the middle of a sentence.

        Args:
            keep_files: leave finished files until they expire (see `expire`), otherwise they are deleted.
        """
        self.stop()
        await asyncio.shield(self._life)
        if not keep_files:
            self.expire(0.0)

    def expire(self, keep_seconds: float) -> bool:
        """Delete files that were finished longer ago; returns whether any are left."""
        return self._said.expire(keep_seconds)

    async def _live(self, production: Production) -> None:
        try:
            await production.run()
            self._ending = True
            await production.close()
        except Exception:
            _log.exception("a stream did not end cleanly")
        finally:
            self._ending = True
            self._frames = production.rendered, production.dropped
            self._pushes = production.audience.pushes.reports()
            self._production = None
            self.ended_at = time.monotonic()

    def _present(self) -> list[Event]:
        started = None if self._production is None else self._production.program.started
        return [Event("state", {"state": self.state}), *([started] if started is not None else [])]

    def _living(self) -> Production:
        if self._ending or self._production is None:
            raise Gone("the stream has ended")
        return self._production
