"""All that works for a stream while it lives: encoders, frames, viewers, and the clock that drives them."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from app.config import Settings
from app.engine.pool import OrderedPool
from app.stream.audience import Audience
from app.stream.broadcast import Broadcast
from app.stream.captions import Captions
from app.stream.clock import BLOCK_SECONDS, FPS, StreamClock
from app.stream.encoder import AacEncoder, OpusEncoder, VideoEncoder
from app.stream.events import Event, EventBoard
from app.stream.film import Film
from app.stream.packet import Packet
from app.stream.pieces import pieces
from app.stream.program import Program
from app.stream.push.push import PushReport
from app.stream.seats import Seats
from app.stream.soundtrack import Samples
from app.stream.timeline import IdlePhase, Timeline
from app.stream.utterance import Script, Utterance
from app.stream.utterances import Utterances

if TYPE_CHECKING:
    from app.engine.avatar import Avatar

DROP_LATE = 0.2
"""Seconds after its deadline at which a frame is not worth encoding any more."""
PLAY_OUT_SECONDS = 0.6
"""How long WebRTC viewers may stay to the end of a stream that ends by itself."""
MAX_FAILURES = 50
"""Steps of the clock that may fail in a row: a second of them."""

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


class Production:
    """See the module. All calls on the event loop; to be closed.

    Args:
        avatar: who speaks.
        said: where utterances are kept.
        events: told what happens.
        captions: given what is said.
        pool: makes the frames.
        settings: of the service.
        folder: for finished files; must exist.
        options: see there.
        phase: where the page's idle clip is, if it shows one.
        seats: for the viewers.
        webrtc_seats: for the WebRTC viewers of all streams.
        push_seats: for the pushes of all streams.

    Attributes:
        state: "waiting" for the first viewer or for sound, "speaking", "idle" or "ended".
        idle_since: since when nobody watches and there is nothing to say, seconds on the monotonic clock, or None.
        audience: who watches.
        program: what is said.
    """

    def __init__(
        self,
        avatar: Avatar,
        said: Utterances,
        events: EventBoard,
        captions: Captions,
        *,
        pool: OrderedPool,
        settings: Settings,
        folder: Path,
        options: StreamOptions,
        phase: IdlePhase | None,
        seats: Seats,
        webrtc_seats: Seats,
        push_seats: Seats,
    ) -> None:
        manifest, stream, engine = avatar.manifest, settings.stream, settings.engine
        if manifest.fps != FPS:
            raise ValueError(f"avatar {manifest.id} has {manifest.fps} frames a second, a stream {FPS}")
        self.avatar = avatar
        self.state: StreamState = "idle"
        self.idle_since: float | None = time.monotonic()
        self._options = options
        self._phase = phase
        self._engine_settings = engine
        self._events = events
        self._wake = asyncio.Event()
        self._stopping = False
        self._grace = 0.0
        self._broadcast: Broadcast[Packet] = Broadcast(stream.queue_seconds)
        self._video = VideoEncoder(
            manifest.width,
            manifest.height,
            FPS,
            preset=stream.preset,
            crf=stream.crf,
            max_kbps=stream.max_kbps,
            keyframe_seconds=stream.keyframe_seconds,
        )
        self._aac, self._opus = AacEncoder(), OpusEncoder()
        self.audience = Audience(
            self._broadcast,
            self._video,
            self._aac,
            self._opus,
            settings,
            seats,
            webrtc_seats,
            push_seats,
            self._audience_changed,
            self._push_changed,
            idle_over_webrtc=options.idle == "stream",
        )
        self.program = Program(
            said, folder, self._video, self._aac, settings, events, captions, self._make_timeline, self._wake.set
        )
        self._said = said
        self._film = Film(avatar, self._video, self._broadcast, self.audience.picture_published)
        self._lane = pool.open(
            self._film.draw,
            self._film.encode,
            look_ahead=engine.look_ahead,
            encode_ahead=engine.encode_ahead,
            drop_late=DROP_LATE,
            on_drop=self._film.dropped,
            on_error=self._film.failed,
        )

    @property
    def rendered(self) -> int:
        """Frames encoded."""
        return self._lane.encoded

    @property
    def dropped(self) -> int:
        """Frames that came too late or failed."""
        return self._lane.dropped

    def say(self, script: Script, utterance: Utterance, *, interrupt: bool) -> None:
        """Queue an utterance.

        Args:
            script: its speech.
            utterance: not yet told how it is made.
            interrupt: cut short what is being said and forget what is queued.

        Raises:
            OverCapacity: too much is queued.
        """
        if interrupt:
            self.program.interrupt(time.monotonic())
        self.program.check_room()
        avatar = utterance.face or self.avatar
        utterance.make = lambda: pieces(avatar, script.speeches, utterance.timings.mark)
        if self.audience.present:
            utterance.timings.mark("viewer")
        self.program.add(utterance)
        self._update_state()

    async def run(self) -> None:
        """Keep the clock until `stop`, until all is said (if `once`), or until it fails again and again."""
        awake = False
        failures = 0
        while not self._stopping:
            try:
                self._step(time.monotonic())
                failures = 0
            except Exception as error:
                # One stream's trouble must not be silent, and must not stop its clock either.
                failures += 1
                if failures == 1:
                    _log.exception("a step of a stream failed")
                if failures == MAX_FAILURES:
                    self._give_up(error)
                    return
            now = time.monotonic()
            busy = self.program.busy or self.audience.expected
            if awake and not busy:
                self.audience.slept()
                if self.program.timeline is not None:
                    self.program.timeline.stop(now)
            if self._options.once and self.program.over:
                self._grace = PLAY_OUT_SECONDS
                return
            awake = busy
            self.idle_since = None if busy else (self.idle_since or now)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self._until_next_step(now) if busy else None):
                    await self._wake.wait()
            self._wake.clear()

    def stop(self) -> None:
        """Let `run` return."""
        self._stopping = True
        self._wake.set()

    async def close(self) -> None:
        """After `run`: viewers get what is queued for them and then the end. Leaves no task, and frees the codecs."""
        self.program.stop()
        self._lane.close()
        await asyncio.to_thread(self._lane.wait)
        self.state = "ended"
        self._events.post(Event("state", {"state": "ended"}))
        self._broadcast.close()
        await self.audience.close(self._grace)
        self._events.close()  # the ends of pushes are told, too
        await self.program.close()
        for encoder in (self._video, self._aac, self._opus):
            encoder.close()

    def _give_up(self, error: Exception) -> None:
        _log.error("a stream ends after %d failed steps in a row", MAX_FAILURES)
        message = f"the stream failed: {type(error).__name__}: {error}"
        self._events.post(Event("error", {"utterance": None, "message": message}))

    def _until_next_step(self, now: float) -> float:
        if self.program.timeline is None:
            return BLOCK_SECONDS
        clock = self.program.timeline.clock
        return max(0.0, clock.sample_release(clock.due_sample(now)) - now)

    def _step(self, now: float) -> None:
        program, audience = self.program, self.audience
        program.step(now, watched=self._options.start == "now" or audience.arrived)
        if program.timeline is not None or audience.present:
            timeline = program.start_timeline()
            current = program.current
            if current is not None and current.end is None:
                timeline.fill(now, current)
            elif audience.present and self._idles_visibly and not self._finale:
                timeline.fill(now, None)
            for position, block in timeline.sound(now):
                self._send_sound(position, block)
        program.finish_files(self._film.passed)
        self._update_state()

    @property
    def _idles_visibly(self) -> bool:
        # A page may show its own clip, a server to which the stream is pushed cannot.
        return self._options.idle == "stream" or self.audience.pushes.live

    @property
    def _finale(self) -> bool:
        # A stream that ends by itself ends with its last word: no idle picture outlasts the sound.
        return self._options.once and self.program.last_words

    def _make_timeline(self) -> Timeline[Utterance]:
        timeline: Timeline[Utterance] = Timeline(
            self.avatar,
            self.avatar.manifest.loop_frames,
            StreamClock(),
            self._lane,
            encode_ahead=self._engine_settings.encode_ahead,
            horizon=self._engine_settings.look_ahead,
        )
        if self._phase is not None:
            timeline.set_phase(self._phase)
        return timeline

    def _send_sound(self, position: int, block: Samples) -> None:
        # A format is encoded only if somebody needs it.
        if self.audience.needs_opus:
            for packet in self._opus.encode(block, position):
                self._broadcast.publish(packet)
        if self.audience.needs_aac or self.program.recording:
            for packet in self._aac.encode(block, position):
                self._broadcast.publish(packet)
                self.program.record(packet)

    def _update_state(self) -> None:
        state: StreamState = "idle"
        if self.program.current is not None:
            state = "speaking"
        elif self.program.waiting:
            state = "waiting"
        if state != self.state:
            self.state = state
            self._events.post(Event("state", {"state": state}))

    def _push_changed(self, push: PushReport) -> None:
        self._events.post(Event("push", {"id": push.id, "state": push.state, "error": push.error or None}))

    def _audience_changed(self) -> None:
        if self.audience.present:
            for utterance in self._said:
                if not utterance.finished:
                    utterance.timings.mark("viewer")
        self._wake.set()
