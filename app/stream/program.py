"""What a stream has to say: the utterance being spoken and those that wait, from narration to the finished file."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections import deque
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, Literal

from app.config import Settings
from app.errors import OverCapacity, SpeechFailed
from app.stream.captions import Captions
from app.stream.clock import FPS, FRAME_SAMPLES
from app.stream.cues import Cues
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.events import Event, EventBoard, EventName
from app.stream.narration import Narration
from app.stream.packet import Packet
from app.stream.pieces import Piece
from app.stream.recording import Recording
from app.stream.timeline import Timeline
from app.stream.utterance import Utterance
from app.stream.utterances import Utterances

MAX_QUEUED = 16
"""Utterances that may wait; one more is refused."""
HANGS_AFTER = 2.5
"""Times `speech.seconds`, which an engine and the one behind it have each (`app.tts.limit`): then something hangs."""
MAX_NARRATIONS = 2
"""Threads of a stream inside the speech engine: one that works, and one that was given up and does not return."""

Outcome = Literal["done", "interrupted", "failed"]

_log = logging.getLogger(__name__)


class Program:
    """Utterances of one stream, one after the other. All calls on the event loop.

    Args:
        said: where they are kept.
        folder: for finished files.
        video, audio: the stream's encoders, whose packets the files hold.
        settings: of the service.
        events: told when an utterance starts, ends and fails, and of its words and mouth shapes.
        captions: given what is said.
        make_timeline: makes the stream's timeline, whose clock starts then.
        on_change: there is something to do for `step`.

    Attributes:
        current: what is being said, until the clock has passed its end.
        started: the event by which its beginning was told, None when its end has been told.
        timeline: of the stream, from the first viewer or the first word on.
    """

    def __init__(
        self,
        said: Utterances,
        folder: Path,
        video: VideoEncoder,
        audio: AacEncoder,
        settings: Settings,
        events: EventBoard,
        captions: Captions,
        make_timeline: Callable[[], Timeline[Utterance]],
        on_change: Callable[[], None],
    ) -> None:
        self.current: Utterance | None = None
        self.started: Event | None = None
        self.timeline: Timeline[Utterance] | None = None
        self._said = said
        self._folder = folder
        self._video = video
        self._audio = audio
        self._settings = settings
        self._limit = HANGS_AFTER * settings.speech.seconds
        self._events = events
        self._cues = Cues(events, captions)
        self._make_timeline = make_timeline
        self._on_change = on_change
        self._loop = asyncio.get_running_loop()
        self._queue: deque[Utterance] = deque()
        self._narrations: list[Narration] = []  # those not seen to have ended
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
        return bool(self._said) and not self._queue and (current is None or current.end is not None)

    @property
    def over(self) -> bool:
        """Something has been said, and nothing is left to do."""
        return bool(self._said) and not self.busy

    def start_timeline(self) -> Timeline[Utterance]:
        """The timeline, made by the first call."""
        if self.timeline is None:
            self.timeline = self._make_timeline()
        return self.timeline

    def check_room(self) -> None:
        """Raise OverCapacity if nothing more can be queued."""
        if len(self._queue) >= MAX_QUEUED:
            raise OverCapacity(f"{MAX_QUEUED} utterances are waiting", advice="Wait until some are spoken.")

    def add(self, utterance: Utterance) -> None:
        """Queue an utterance; its narration begins when those before it are made."""
        self._queue.append(utterance)
        self._said.add(utterance)
        self._narrate_next()
        self._on_change()

    def interrupt(self, now: float) -> None:
        """Forget what waits and cut short what is being said."""
        while self._queue:
            self._conclude(self._queue.popleft(), "interrupted", None)
        current = self.current
        if current is not None and current.state == "speaking":
            timeline = self.start_timeline()
            self._close(current, timeline.interrupt(now, current))
            self._cues.cut(timeline.sent)
            self._conclude(current, "interrupted", current.end)
        self._on_change()

    def stop(self) -> None:
        """The stream ends here and now: what is not finished is interrupted."""
        self._queue.clear()
        if self.timeline is not None:
            self._cues.cut(self.timeline.sent)
        for utterance in self._said:
            if utterance.finished:
                continue
            if utterance.start is not None:
                passed = max(utterance.start, self.start_timeline().sent // FRAME_SAMPLES)
                utterance.end = passed if utterance.end is None else min(passed, utterance.end)
            self._conclude(utterance, "interrupted", utterance.end)

    def step(self, now: float, *, watched: bool) -> None:
        """Bring what is said up to date.

        Args:
            now: seconds on the clock.
            watched: speech may start; otherwise it waits `stream.start_seconds`.
        """
        self._check_narrations()
        self._finish_current()
        if self.current is None:
            self._start_next(now, watched)
        if self.current is not None and self.current.end is None:
            self._place(self.current, now)
        if self.timeline is not None:
            self._cues.tell(self.timeline.sent)

    def record(self, packet: Packet) -> None:
        """Give the files a packet of the stream's sound."""
        for utterance in self._open:
            if utterance.recording is not None:
                utterance.recording.add(packet)

    def finish_files(self, passed: int) -> None:
        """Finish the files that have all they need; `passed` is the last frame encoded or dropped."""
        for utterance in list(self._open):
            recording, end = utterance.recording, utterance.end
            if recording is None or recording.failed:
                self._open.remove(utterance)
            elif recording.has_all_sound and end is not None and passed >= end - 1:
                self._open.remove(utterance)
                self._background(asyncio.to_thread(recording.finish))

    async def close(self) -> None:
        """Let go of everything, after `stop`; what has no finished file will have none.

        A speech engine in the middle of a sentence is not waited for.
        """
        unfinished = [utterance.recording for utterance in self._open if utterance.recording is not None]
        self._open.clear()
        self.current = None
        await asyncio.gather(*(asyncio.to_thread(each.remove) for each in unfinished), return_exceptions=True)
        await asyncio.gather(*self._finishing, return_exceptions=True)
        for narration in self._narrations:
            self._loop.call_later(self._limit, _report_left, narration.thread)

    # --- speech -------------------------------------------------------------------------------------------------------

    def _narrate_next(self) -> None:
        # One at a time: the next text becomes speech when the one before is made, not before it is needed.
        for utterance in self._unnarrated():
            if utterance.narration is None and self._engine_is_free():
                utterance.narration = Narration(utterance.make, self._deliverer(utterance), "mary-narration")
                self._narrations.append(utterance.narration)
            return

    def _unnarrated(self) -> list[Utterance]:
        return [each for each in [self.current, *self._queue] if each is not None and not each.narrated]

    def _engine_is_free(self) -> bool:
        # A sentence cannot be stopped: what was cancelled goes on for a while, and must not add up.
        self._narrations = [each for each in self._narrations if not each.ended]
        return len(self._narrations) < MAX_NARRATIONS and all(map(self._hangs, self._narrations))

    def _hangs(self, narration: Narration) -> bool:
        return narration.seconds_on_piece >= self._limit

    def _deliverer(self, utterance: Utterance) -> Callable[[Piece | BaseException | None], None]:
        def deliver(piece: Piece | BaseException | None) -> None:
            with contextlib.suppress(RuntimeError):  # the event loop is gone, and with it whoever would listen
                self._loop.call_soon_threadsafe(self._delivered, utterance, piece)

        return deliver

    def _delivered(self, utterance: Utterance, piece: Piece | BaseException | None) -> None:
        if not utterance.narrated:  # otherwise it was given up meanwhile
            if isinstance(piece, Piece):
                utterance.ready.append(piece)
            elif piece is None:
                utterance.narrated = True
            else:
                self._fail(utterance, piece)
        self._narrate_next()
        self._on_change()

    def _check_narrations(self) -> None:
        limit = self._limit
        hanging = [each for each in self._narrations if not each.ended and self._hangs(each)]
        for utterance in self._unnarrated():
            if utterance.narration in hanging:
                self._fail(utterance, SpeechFailed(f"the speech engine took longer than {limit:g} s for one sentence"))
            elif utterance.narration is None and len(hanging) >= MAX_NARRATIONS:
                self._fail(utterance, SpeechFailed("the speech engine does not return from earlier sentences"))
        self._narrate_next()

    def _fail(self, utterance: Utterance, error: BaseException) -> None:
        if utterance.narration is not None:
            utterance.narration.cancel()
        utterance.fail(error)
        _log.warning("an utterance failed: %s", type(error).__name__)
        self._events.post(Event("error", {"utterance": utterance.id, "message": utterance.error}))

    # --- on the clock -------------------------------------------------------------------------------------------------

    def _start_next(self, now: float, watched: bool) -> None:
        while self._queue:
            utterance = self._queue[0]
            if utterance.narrated and not utterance.ready:  # nothing came of it
                self._queue.popleft()
                self._conclude(utterance, "failed" if utterance.error else "done", None)
                continue
            waited = now - utterance.received >= self._settings.stream.start_seconds
            if utterance.ready and (watched or waited):
                self._queue.popleft()
                timeline = self.start_timeline()
                if utterance.phase is not None:
                    timeline.set_phase(utterance.phase)
                utterance.base = timeline.begin(now)
                utterance.state = "speaking"
                self.current = utterance
            return

    def _place(self, utterance: Utterance, now: float) -> None:
        timeline = self.start_timeline()
        while utterance.ready:
            if utterance.recording is None:
                path = self._folder / f"{utterance.id}.mp4"
                utterance.recording = Recording(path, self._video, self._audio, utterance.base)
                self._open.append(utterance)
            piece = utterance.ready[0]
            utterance.base += timeline.place(piece, utterance.base, utterance, now)
            utterance.ready.popleft()
            self._cues.add(utterance.id, piece, utterance.base, timeline.clock)
            if utterance.narration is not None:
                utterance.narration.taken()
            utterance.last = utterance.base + piece.frame + len(piece.coefficients)
            if utterance.start is None:
                utterance.start = utterance.base
                loop_frame = timeline.loop_frame(utterance.base)
                self.started = self._post("speak_started", utterance, utterance.base, loop_frame=loop_frame)
        if utterance.narrated and utterance.error:
            self._close(utterance, timeline.close_mouth(now, utterance))
            self._conclude(utterance, "failed", utterance.end)
        elif utterance.narrated:
            self._close(utterance, utterance.last)

    def _close(self, utterance: Utterance, end: int) -> None:
        # Its end is known. It remains the current one until the clock gets there.
        utterance.end = end
        if utterance.recording is not None:
            utterance.recording.end_at(end)

    def _finish_current(self) -> None:
        # By the sound that has left and not by the time: after a pause of the whole process there is more to be sent.
        current = self.current
        if current is None or current.end is None or self.start_timeline().sent < current.end * FRAME_SAMPLES:
            return
        if not current.finished:
            self._conclude(current, "done", current.end)
        self.current = None

    def _conclude(self, utterance: Utterance, outcome: Outcome, frame: int | None) -> None:
        # Every utterance comes here exactly once; `frame` is None if nothing of it was to be heard.
        utterance.finish(outcome)
        if utterance is self.current:
            self.started = None
        self._post("speak_ended", utterance, frame, reason=outcome)

    def _post(self, name: EventName, utterance: Utterance, frame: int | None, **more: Any) -> Event:
        media_time = None if frame is None else frame / FPS
        wall_ms = None if frame is None else self.start_timeline().clock.wall_ms(frame / FPS)
        event = Event(name, {"utterance": utterance.id, "media_time": media_time, "wall_ms": wall_ms, **more})
        self._events.post(event)
        return event

    def _background(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._finishing.add(task)
        task.add_done_callback(self._finishing.discard)


def _report_left(thread: threading.Thread) -> None:
    if thread.is_alive():
        _log.error("a speech engine does not return; its thread is left behind")
