"""What a stream has to say: the utterance being spoken and those that wait, from narration to the finished file."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, Literal

from app.config import Settings
from app.errors import NotFound, OverCapacity, SpeechFailed
from app.stream.clock import FPS
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.events import Event, EventBoard
from app.stream.narration import Narration
from app.stream.packet import Packet
from app.stream.pieces import Piece
from app.stream.recording import Recording
from app.stream.timeline import Timeline
from app.stream.utterance import Utterance

MAX_QUEUED = 16
"""Utterances that may wait; one more is refused."""
KEPT_UTTERANCES = 50
"""Utterances a stream remembers; with the oldest its file goes."""

_log = logging.getLogger(__name__)


class Program:
    """Utterances of one stream, one after the other. All calls on the event loop.

    Args:
        folder: for finished files.
        video, audio: the stream's encoders, whose packets the files hold.
        settings: of the service.
        events: told when an utterance starts, ends and fails.
        on_change: there is something to do for `step`.
    """

    def __init__(
        self,
        folder: Path,
        video: VideoEncoder,
        audio: AacEncoder,
        settings: Settings,
        events: EventBoard,
        on_change: Callable[[], None],
    ) -> None:
        self.utterances: dict[str, Utterance] = {}
        self.current: Utterance | None = None
        self._folder = folder
        self._video = video
        self._audio = audio
        self._settings = settings
        self._events = events
        self.started: Event | None = None
        self._on_change = on_change
        self._loop = asyncio.get_running_loop()
        self._queue: deque[Utterance] = deque()
        self._open: list[Utterance] = []  # those whose files are not finished
        self._finishing: set[asyncio.Task[None]] = set()

    @property
    def waiting(self) -> bool:
        """Something is queued."""
        return bool(self._queue)

    @property
    def recording(self) -> bool:
        """A file needs the stream's packets."""
        return bool(self._open)

    @property
    def busy(self) -> bool:
        """Something is being said, waits to be said, or is being written."""
        return bool(self.current or self._queue or self._open)

    @property
    def last_words(self) -> bool:
        """Everything said so far has its place on the clock, and nothing is queued."""
        current = self.current
        return bool(self.utterances) and not self._queue and (current is None or current.end is not None)

    def check_room(self) -> None:
        """Raise OverCapacity if nothing more can be queued."""
        if len(self._queue) >= MAX_QUEUED:
            raise OverCapacity(f"{MAX_QUEUED} utterances are waiting", advice="Wait until some are spoken.")

    def add(self, utterance: Utterance) -> None:
        """Queue an utterance; its narration begins when those before it are made."""
        self.utterances[utterance.id] = utterance
        self._queue.append(utterance)
        self._narrate_next()
        self._forget_oldest()
        self._on_change()

    def interrupt(self, timeline: Timeline[Utterance] | None, now: float) -> None:
        """Forget what waits and cut short what is being said."""
        while self._queue:
            utterance = self._queue.popleft()
            utterance.cancel()
            utterance.state = "interrupted"
        current = self.current
        if current is not None and current.state == "speaking" and timeline is not None:
            current.cancel()
            self._close(current, timeline, timeline.interrupt(now, current), "interrupted")
        self._on_change()

    def find(self, utterance: str) -> Utterance:
        """The utterance of this id; NotFound if there is none (any more)."""
        found = self.utterances.get(utterance)
        if found is None:
            raise NotFound(f"no utterance {utterance}")
        return found

    def step(
        self, now: float, may_start: Callable[[Utterance], bool], start: Callable[[], Timeline[Utterance]]
    ) -> None:
        """Bring what is said up to date.

        Args:
            now: seconds on the clock.
            may_start: whether this utterance, the next, may be spoken now.
            start: gives the stream's timeline; called when something is to be spoken.
        """
        self._check_narrations()
        if self.current is not None:
            self._finish_current(start(), now)
        if self.current is None:
            self._start_next(now, may_start, start)
        if self.current is not None and self.current.end is None:
            self._place(self.current, start(), now)

    def record(self, packet: Packet) -> None:
        """Give the files a packet of the stream's sound."""
        for utterance in self._open:
            if utterance.recording is not None:
                utterance.recording.add(packet)

    def finish_files(self, passed: int) -> None:
        """Finish the files that have all they need; `passed` is the last frame encoded or dropped."""
        for utterance in list(self._open):
            recording, end = utterance.recording, utterance.end
            if recording is not None and end is not None and recording.complete and passed >= end - 1:
                self._open.remove(utterance)
                self._background(asyncio.to_thread(recording.finish))

    def expire(self, keep_seconds: float) -> bool:
        """Delete files that were finished longer ago; returns whether any are left."""
        now = time.monotonic()
        left = False
        for utterance in self.utterances.values():
            recording = utterance.recording
            if recording is not None and recording.ready:
                if now - recording.finished_at >= keep_seconds:
                    recording.remove()
                else:
                    left = True
        return left

    async def close(self) -> None:
        """Stop everything; what is not finished is interrupted and has no file. Waits for the narrations' threads."""
        for utterance in self.utterances.values():
            if not utterance.finished:
                utterance.cancel()
                utterance.state = "interrupted"
        for utterance in self._open:
            if utterance.recording is not None:
                await asyncio.to_thread(utterance.recording.remove)
        self._queue.clear()
        self._open.clear()
        self.current = None
        await asyncio.gather(*self._finishing, return_exceptions=True)
        for utterance in self.utterances.values():
            narration = utterance.narration
            if narration is not None and not await asyncio.to_thread(narration.join, self._settings.speech.seconds):
                _log.error("a speech engine does not return; its thread is left behind")

    # --- speech -------------------------------------------------------------------------------------------------------

    def _narrate_next(self) -> None:
        # One at a time: the next text becomes speech when the one before is made, not before it is needed.
        for utterance in [self.current, *self._queue]:
            if utterance is None or utterance.narrated:
                continue
            if utterance.narration is None:
                utterance.narration = Narration(utterance.make, self._deliverer(utterance), "mary-narration")
            return

    def _deliverer(self, utterance: Utterance) -> Callable[[Piece | BaseException | None], None]:
        def deliver(piece: Piece | BaseException | None) -> None:
            with contextlib.suppress(RuntimeError):  # the event loop is gone, and with it whoever would listen
                self._loop.call_soon_threadsafe(self._delivered, utterance, piece)

        return deliver

    def _delivered(self, utterance: Utterance, piece: Piece | BaseException | None) -> None:
        if utterance.narrated:
            return  # cancelled meanwhile
        if isinstance(piece, Piece):
            utterance.ready.append(piece)
        elif piece is None:
            utterance.narrated = True
        else:
            self._fail(utterance, piece)
        self._narrate_next()
        self._on_change()

    def _check_narrations(self) -> None:
        limit = self._settings.speech.seconds
        for utterance in [self.current, *self._queue]:
            narration = utterance.narration if utterance is not None else None
            if utterance is None or utterance.narrated or narration is None or narration.seconds_on_piece < limit:
                continue
            narration.cancel()
            self._fail(utterance, SpeechFailed(f"the speech engine took longer than {limit:g} s for one sentence"))
            self._narrate_next()

    def _fail(self, utterance: Utterance, error: BaseException) -> None:
        utterance.fail(error)
        _log.warning("an utterance failed: %s", type(error).__name__)
        self._events.post(Event("error", {"utterance": utterance.id, "message": utterance.error}))

    # --- on the clock -------------------------------------------------------------------------------------------------

    def _start_next(
        self, now: float, may_start: Callable[[Utterance], bool], start: Callable[[], Timeline[Utterance]]
    ) -> None:
        while self._queue:
            utterance = self._queue[0]
            if not utterance.ready and utterance.narrated:  # nothing came of it
                self._queue.popleft()
                utterance.state = "failed" if utterance.error else "done"
                continue
            if utterance.ready and may_start(utterance):
                self._queue.popleft()
                timeline = start()
                if utterance.phase is not None:
                    timeline.set_phase(utterance.phase)
                utterance.base = timeline.begin(now)
                utterance.state = "speaking"
                self.current = utterance
            return

    def _place(self, utterance: Utterance, timeline: Timeline[Utterance], now: float) -> None:
        while utterance.ready:
            piece = utterance.ready.popleft()
            if utterance.narration is not None:
                utterance.narration.taken()
            if utterance.recording is None:
                path = self._folder / f"{utterance.id}.mp4"
                utterance.recording = Recording(path, self._video, self._audio, utterance.base)
                self._open.append(utterance)
            utterance.base += timeline.place(piece, utterance.base, utterance, now)
            utterance.last = utterance.base + piece.frame + len(piece.coefficients)
            if utterance.start is None:
                utterance.start = utterance.base
                loop_frame = timeline.loop_frame(utterance.base)
                self.started = self._post("speak_started", utterance, timeline, utterance.base, loop_frame=loop_frame)
        if utterance.narrated and utterance.error:
            self._close(utterance, timeline, timeline.close_mouth(now, utterance), "failed")
        elif utterance.narrated:
            self._close(utterance, timeline, utterance.last, "speaking")

    def _close(
        self,
        utterance: Utterance,
        timeline: Timeline[Utterance],
        end: int,
        state: Literal["speaking", "interrupted", "failed"],
    ) -> None:
        # Its end is known. It remains the current one until the clock gets there.
        utterance.end = end
        utterance.state = state
        if utterance.recording is not None:
            utterance.recording.end_at(end)
        if state != "speaking":
            self.started = None
            self._post("speak_ended", utterance, timeline, end, reason=state)

    def _finish_current(self, timeline: Timeline[Utterance], now: float) -> None:
        current = self.current
        if current is None or current.end is None or timeline.clock.frame_release(current.end) > now:
            return
        self.current = None
        if current.state == "speaking":
            current.state = "done"
            self.started = None
            self._post("speak_ended", current, timeline, current.end, reason="done")

    def _post(self, name: str, utterance: Utterance, timeline: Timeline[Utterance], frame: int, **more: Any) -> Event:
        wall_ms = timeline.clock.wall_ms(frame)
        event = Event(name, {"utterance": utterance.id, "media_time": frame / FPS, "wall_ms": wall_ms, **more})
        self._events.post(event)
        return event

    def _forget_oldest(self) -> None:
        while len(self.utterances) > KEPT_UTTERANCES:
            oldest = next(iter(self.utterances.values()))
            if not oldest.finished or oldest in self._open:
                return
            del self.utterances[oldest.id]
            if oldest.recording is not None:
                oldest.recording.remove()

    def _background(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._finishing.add(task)
        task.add_done_callback(self._finishing.discard)
