"""One live stream: things to say, one after the other, on one clock, encoded once for any number of viewers."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from app.config import Settings
from app.engine.pool import OrderedPool
from app.errors import Gone, NotFound, NotReady
from app.stream.audience import Audience, Format
from app.stream.broadcast import Broadcast
from app.stream.clock import BLOCK_SECONDS, FPS, StreamClock
from app.stream.encoder import AacEncoder, OpusEncoder, VideoEncoder
from app.stream.events import Event, EventBoard
from app.stream.film import Film
from app.stream.packet import Packet
from app.stream.pieces import pieces
from app.stream.program import Program
from app.stream.soundtrack import Samples
from app.stream.timeline import IdlePhase, Timeline
from app.stream.timing import LatencyLog, LoggedUtterance
from app.stream.utterance import Narrator, Utterance, UtteranceReport

if TYPE_CHECKING:
    from app.engine.avatar import Avatar

DROP_LATE = 0.2
"""Seconds after its deadline at which a frame is not worth encoding any more."""
PLAY_OUT_SECONDS = 0.6
"""How long WebRTC viewers may stay to the end of a stream that ends by itself."""

StreamState = Literal["waiting", "idle", "speaking", "ended"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class StreamOptions:
    """How a stream behaves.

    Attributes:
        start: "viewer" = speech waits for the first viewer (at most `stream.start_seconds`), "now" = it does not.
        idle: "stream" = the background is sent while there is nothing to say, "local" = no video then.
        once: end when everything said so far is done.
    """

    start: Literal["viewer", "now"] = "viewer"
    idle: Literal["stream", "local"] = "stream"
    once: bool = False


@dataclass(frozen=True, slots=True)
class StreamReport:
    """A stream as the outside sees it. `viewers` by transport; frames `rendered` (encoded) and `dropped` (too late)."""

    id: str
    state: StreamState
    avatar: str
    voice: str
    viewers: dict[str, int]
    utterances: tuple[UtteranceReport, ...]
    rendered: int
    dropped: int


class LiveStream:
    """See the module. All calls on the event loop it was created on.

    With nobody watching and nothing to say it does no work. A viewer can slow down neither the clock nor another
    viewer: all of them read from bounded queues.

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

    Attributes:
        idle_since: since when nobody watches and there is nothing to say, seconds on the monotonic clock, or None.
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
        options: StreamOptions = StreamOptions(),
        phase: IdlePhase | None = None,
    ) -> None:
        manifest = avatar.manifest
        if manifest.fps != FPS:
            raise ValueError(f"avatar {manifest.id} has {manifest.fps} frames a second, a stream {FPS}")
        self.id = secrets.token_urlsafe(16)
        self.avatar = avatar
        self.voice = voice
        self.options = options
        self.idle_since: float | None = time.monotonic()
        self._narrator = narrator
        self._settings = settings
        self._latency = latency
        self._phase = phase
        self._state: StreamState = "idle"
        self._wake = asyncio.Event()
        self._events = EventBoard()
        self._broadcast: Broadcast[Packet] = Broadcast(settings.stream.queue_seconds)
        self._video = VideoEncoder(
            manifest.width,
            manifest.height,
            FPS,
            preset=settings.stream.preset,
            crf=settings.stream.crf,
            max_kbps=settings.stream.max_kbps,
            keyframe_seconds=settings.stream.keyframe_seconds,
        )
        self._aac, self._opus = AacEncoder(), OpusEncoder()
        self._audience = Audience(self._broadcast, self._video, self._aac, settings, self._audience_changed)
        self._program = Program(folder, self._video, self._aac, settings, self._events, self._wake.set)
        self._film = Film(avatar, self._video, self._broadcast, self._audience.picture_published)
        self._lane = pool.open(
            self._film.draw,
            self._film.encode,
            look_ahead=settings.engine.look_ahead,
            encode_ahead=settings.engine.encode_ahead,
            drop_late=DROP_LATE,
            on_drop=self._film.dropped,
            on_error=lambda error: _log.error("a frame cannot be made", exc_info=error),
        )
        self._timeline: Timeline[Utterance] | None = None  # from the first viewer or the first word on
        loop = asyncio.get_running_loop()
        self._ending: asyncio.Task[None] | None = None
        self._ended_by_itself = False
        self._runner = loop.create_task(self._run(), name=f"stream-{self.id[:6]}")

    @property
    def state(self) -> StreamState:
        """What it does: "waiting" for its first viewer or for sound, "speaking", "idle", or it has "ended"."""
        return self._state

    def say(
        self,
        text: str,
        *,
        interrupt: bool = False,
        voice: str | None = None,
        speed: float = 1.0,
        phase: IdlePhase | None = None,
    ) -> Utterance:
        """Queue a text; returns at once, the work happens in the background.

        Args:
            text: what to say.
            interrupt: cut short what is being said and forget what is queued.
            voice: another voice than the stream's.
            speed: 1 = the voice's own pace.
            phase: where the page's idle clip is, if it shows one.

        Raises:
            Gone: the stream has ended.
            NothingToSay, InputError, NotFound: what the narrator says about text, speed or voice.
            OverCapacity: too much is queued.
        """
        self._must_live()
        script = self._narrator(text, voice or self.voice, speed)
        if interrupt:
            self.interrupt()
        self._program.check_room()
        utterance = Utterance(len(text), script.unread, phase)
        utterance.make = lambda: pieces(self.avatar, script.speeches, utterance.timings.mark)
        if self._audience.present:
            utterance.timings.mark("viewer")
        self._latency.add(LoggedUtterance(self.id, utterance.id, utterance.characters, utterance.timings))
        self._program.add(utterance)
        self._update_state()
        return utterance

    def interrupt(self) -> None:
        """Fall silent within two frames, close the mouth, and forget what is queued.

        Raises:
            Gone: the stream has ended.
        """
        self._must_live()
        self._program.interrupt(self._timeline, time.monotonic())

    def shown(self, utterance: str, milliseconds: float) -> None:
        """The browser showed the first frame so long after the request.

        Raises:
            NotFound: no such utterance.
        """
        self._program.find(utterance).timings.set("shown", milliseconds)

    def watch(self, format: Format) -> AsyncIterator[bytes]:
        """The stream in a container format; a viewer as long as it is iterated. Close the iterator.

        Raises:
            Gone: the stream has ended.
        """
        self._must_live()
        return self._audience.watch(format)

    async def whep(self, offer: str) -> tuple[str, str]:
        """Answer a WebRTC offer; returns the viewer's id and the SDP.

        Raises:
            Gone: the stream has ended.
            NegotiationFailed: the offer cannot be answered.
        """
        self._must_live()
        peer = await self._audience.answer(offer)
        if self._ending is not None:  # meanwhile
            await peer.close()
            self._must_live()
        return peer.id, peer.answer

    async def leave(self, viewer: str) -> None:
        """Disconnect a WebRTC viewer.

        Raises:
            NotFound: no such viewer.
        """
        await self._audience.leave(viewer)

    def events(self) -> AsyncIterator[Event]:
        """What happens from the first iteration on; ends with the stream.

        First come the present state and, if something is being said, its `speak_started` once more.
        """
        return self._events.listen(self._present)

    def _present(self) -> list[Event]:
        started = self._program.started
        return [Event("state", {"state": self._state}), *([started] if started is not None else [])]

    def report(self) -> StreamReport:
        """The present state."""
        return StreamReport(
            self.id,
            self._state,
            self.avatar.manifest.id,
            self.voice,
            self._audience.count(),
            tuple(utterance.report() for utterance in self._program.utterances.values()),
            self._lane.encoded,
            self._lane.dropped,
        )

    def video(self, utterance: str | None = None) -> Path:
        """The finished file of an utterance, by default of the last.

        Raises:
            NotFound: no such utterance, or it has no file (any more).
            NotReady: it is still being spoken or written.
        """
        if utterance is None and not self._program.utterances:
            raise NotFound("nothing has been said yet")
        chosen = (
            next(reversed(self._program.utterances.values())) if utterance is None else self._program.find(utterance)
        )
        recording = chosen.recording
        if recording is not None and recording.ready:
            return recording.path
        if not chosen.finished or (recording is not None and not recording.failed):
            raise NotReady("the video is being made", advice="Try again when the utterance has ended.")
        raise NotFound("this utterance has no video", advice="Videos are kept for a limited time.")

    async def end(self, *, keep_files: bool = False) -> None:
        """End the stream: viewers get what is queued for them and then the end. Leaves no thread and no task.

        Args:
            keep_files: leave finished files until they expire (see `expire`), otherwise they are deleted.
        """
        if self._ending is None:
            self._ending = asyncio.get_running_loop().create_task(self._end(), name=f"end-{self.id[:6]}")
        await asyncio.shield(self._ending)
        if not keep_files:
            self.expire(0.0)

    def expire(self, keep_seconds: float) -> bool:
        """Delete files that were finished longer ago; returns whether any are left."""
        return self._program.expire(keep_seconds)

    async def _end(self) -> None:
        self._runner.cancel()
        await asyncio.gather(self._runner, return_exceptions=True)
        self._lane.close()
        await asyncio.to_thread(self._lane.wait)
        self._state = "ended"
        self._events.post(Event("state", {"state": "ended"}))
        self._events.close()
        self._broadcast.close()
        await self._audience.close(PLAY_OUT_SECONDS if self._ended_by_itself else 0.0)
        await self._program.close()

    async def _run(self) -> None:
        awake = False
        while True:
            try:
                self._step(time.monotonic())
            except Exception:
                # One stream's trouble must not be silent, and must not stop its clock either.
                _log.exception("a step of a stream failed")
            now = time.monotonic()
            busy = self._program.busy or self._audience.expected
            if awake and not busy:
                self._audience.slept()
                if self._timeline is not None:
                    self._timeline.stop(now)
            if self.options.once and self._program.utterances and not self._program.busy:
                break
            awake = busy
            self.idle_since = None if busy else (self.idle_since or now)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self._until_next_step(now) if busy else None):
                    await self._wake.wait()
            self._wake.clear()
        self._ended_by_itself = True
        self._ending = self._ending or asyncio.get_running_loop().create_task(self._end())

    def _until_next_step(self, now: float) -> float:
        if self._timeline is None:
            return BLOCK_SECONDS
        clock = self._timeline.clock
        return max(0.0, clock.sample_release(clock.due_sample(now)) - now)

    def _step(self, now: float) -> None:
        self._program.step(now, lambda utterance: self._may_start(utterance, now), self._started)
        if self._timeline is not None or self._audience.present:
            timeline = self._started()
            current = self._program.current
            if current is not None and current.end is None:
                timeline.fill(now, current)
            elif self._audience.present and self.options.idle == "stream" and not self._finale:
                timeline.fill(now, None)
            for position, block in timeline.sound(now):
                self._send_sound(position, block)
        self._program.finish_files(self._film.passed)
        self._update_state()

    @property
    def _finale(self) -> bool:
        # A stream that ends by itself ends with its last word: no idle picture outlasts the sound.
        return self.options.once and self._program.last_words

    def _may_start(self, utterance: Utterance, now: float) -> bool:
        waited = now - utterance.received >= self._settings.stream.start_seconds
        return self.options.start == "now" or self._audience.arrived or waited

    def _started(self) -> Timeline[Utterance]:
        if self._timeline is None:
            engine = self._settings.engine
            self._timeline = Timeline(
                self.avatar,
                self.avatar.manifest.loop_frames,
                StreamClock(),
                self._lane,
                encode_ahead=engine.encode_ahead,
                horizon=engine.look_ahead,
            )
            if self._phase is not None:
                self._timeline.set_phase(self._phase)
        return self._timeline

    def _send_sound(self, position: int, block: Samples) -> None:
        # A format is encoded only if somebody needs it.
        if self._audience.over_webrtc:
            for packet in self._opus.encode(block, position):
                self._broadcast.publish(packet)
        if self._audience.over_http or self._program.recording:
            for packet in self._aac.encode(block, position):
                self._broadcast.publish(packet)
                self._program.record(packet)

    def _update_state(self) -> None:
        state: StreamState = "idle"
        if self._program.current is not None:
            state = "speaking"
        elif self._program.waiting:
            state = "waiting"
        if state != self._state:
            self._state = state
            self._events.post(Event("state", {"state": state}))

    def _audience_changed(self) -> None:
        if self._audience.present:
            for utterance in self._program.utterances.values():
                if not utterance.finished:
                    utterance.timings.mark("viewer")
        self._wake.set()

    def _must_live(self) -> None:
        if self._ending is not None:
            raise Gone("the stream has ended")
