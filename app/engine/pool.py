"""The ordered-encoding pool: Fu 2011, Figure 4-4, for many streams at once.

A frame is unsynthesised (list A), synthesised (list B) or encoded. In the figure every worker does this::

    while not all frames are encoded:
        LOCK(A); grab the earliest unsynthesised frame F; UNLOCK(A)
        synthesise F and put it into B
        TRYLOCK(P):                                   nobody ever waits for the encoder
            while P points to a synthesised frame:    encoding state
                encode it, move P forward
        UNLOCK(P)

As printed it can strand a frame: a worker that puts F into B and fails TRYLOCK just before the holder unlocks goes
away, and the holder has already looked. Here the holder looks once more after UNLOCK.

What is added for live streams: every stream is a `Lane` with its own A, B and P, and all lanes share one set of
workers, which take what has the earliest deadline over all lanes. A frame is synthesised at most `look_ahead` seconds
and encoded at most `encode_ahead` seconds before its deadline, so that an interruption finds frames that can still be
taken back; after every encoded frame the drain gives way to an earlier deadline of another lane; frames that are too
late are skipped. Lanes without deadlines (files) run flat out in the time that is left.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, NamedTuple

from app.engine.frame import Picture

BUFFERED_FRAMES = 32
"""Synthesised frames a lane may hold for a slow encoder (12.6 MB at 512x512); `look_ahead` bounds live lanes before."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class FrameJob:
    """One frame to make.

    Attributes:
        index: number of the frame in its lane.
        deadline: when it must have been encoded, seconds on the pool's clock; 0.0 = whenever there is time (files).
        payload: whatever the lane's `synthesise` needs.
    """

    index: int
    deadline: float
    payload: Any = None


class _State(Enum):
    UNSYNTHESISED = auto()
    TAKEN = auto()  # a worker is synthesising it
    SYNTHESISED = auto()
    SKIPPED = auto()  # too late, or its synthesis failed; P passes over it
    DISCARDED = auto()  # taken back; a picture that still arrives is thrown away


@dataclass(slots=True, eq=False)
class _Frame:
    # One submission of a job. Its identity tells a discarded frame from the one submitted again under the same index.
    job: FrameJob
    state: _State = _State.UNSYNTHESISED
    picture: Picture | None = None

    @property
    def due(self) -> float:
        return self.job.deadline or math.inf


class _Task(NamedTuple):
    lane: Lane
    encode: bool  # P is ready; otherwise the first frame of A is to be synthesised
    due: float


class Lane:
    """One stream of frames in the pool. Made by `OrderedPool.open`; every method may be called from any thread.

    `synthesise` runs on several workers at once. `encode` and `on_drop` of one lane run one at a time and in order.

    Attributes:
        encoded: frames encoded.
        dropped: frames skipped because they were late or because making them failed.
        error: the first error, if the lane was opened without `on_error`.
    """

    def __init__(
        self,
        pool: OrderedPool,
        synthesise: Callable[[FrameJob], Picture],
        encode: Callable[[FrameJob, Picture], None],
        look_ahead: float,
        encode_ahead: float,
        drop_late: float,
        on_drop: Callable[[FrameJob], None] | None,
        on_error: Callable[[BaseException], None] | None,
    ) -> None:
        self.encoded = 0
        self.dropped = 0
        self.error: BaseException | None = None
        self._pool = pool
        self._synthesise = synthesise
        self._encode = encode
        self._look_ahead = look_ahead
        self._encode_ahead = encode_ahead
        self._drop_late = drop_late
        self._on_drop = on_drop
        self._on_error = on_error
        self._unsynthesised: deque[_Frame] = deque()  # A
        self._order: deque[_Frame] = deque()  # every frame not yet encoded; P is its first, B its synthesised ones
        self._buffered = 0  # frames in B or being synthesised
        self._encoder = threading.Lock()  # LOCK(P)
        self._passed = -1  # index of the last frame that P has left behind
        self._running = 0  # calls of ours that are running on workers
        self._served = 0  # when this lane last got a worker, for fairness between lanes without deadlines
        self._finished = False

    @property
    def pending(self) -> int:
        """Frames submitted and not yet encoded, dropped or discarded (one that is being encoded is not counted)."""
        return len(self._order)

    def submit(self, jobs: Iterable[FrameJob]) -> None:
        """Append frames to A. Indices must increase strictly.

        Raises:
            ValueError: an index does not increase.
            RuntimeError: the lane or the pool is finished or closed.
            BaseException: the lane's first error, if it was opened without `on_error`.
        """
        with self._pool._mutex:
            if self.error is not None:
                raise self.error
            if self._finished or self._pool._closed:
                raise RuntimeError("the lane takes no more frames")
            last = self._order[-1].job.index if self._order else self._passed
            for job in jobs:
                if job.index <= last:
                    raise ValueError(f"frame {job.index} submitted after frame {last}")
                last = job.index
                frame = _Frame(job)
                self._unsynthesised.append(frame)
                self._order.append(frame)
            self._pool._work.notify()

    def discard(self, first: int) -> int:
        """Take back all frames with index >= `first` that are not encoded and not being encoded.

        Their indices may be submitted again. Returns how many were taken back (the last ones submitted).
        """
        count = 0
        with self._pool._mutex:
            while self._order and self._order[-1].job.index >= first:
                frame = self._order.pop()
                if frame.state in (_State.TAKEN, _State.SYNTHESISED):
                    self._buffered -= 1
                frame.state = _State.DISCARDED
                frame.picture = None
                count += 1
            while self._unsynthesised and self._unsynthesised[-1].state is _State.DISCARDED:
                self._unsynthesised.pop()
            self._pool._settle(self)
        return count

    def finish(self) -> None:
        """Say that no more frames will come; the lane leaves the pool when the last is encoded."""
        with self._pool._mutex:
            self._finished = True
            self._pool._settle(self)

    def close(self) -> None:
        """Abandon all frames and leave the pool. Returns at once; `wait` returns after the last running call."""
        self.finish()
        self.discard(-1)

    def wait(self, timeout: float | None = None) -> bool:
        """Block until every frame submitted is encoded or dropped and no call of this lane is running.

        Not to be called from the lane's own callbacks. Returns False if that took longer than `timeout` seconds.

        Raises:
            BaseException: the lane's first error, if it was opened without `on_error`.
        """
        with self._pool._mutex:
            done = self._pool._settled.wait_for(lambda: not self._order and not self._running, timeout)
        if self.error is not None:
            raise self.error
        return done

    def _ready(self, now: float) -> bool:
        # P points to a frame that can be passed now.
        if not self._order:
            return False
        frame = self._order[0]
        if frame.state is _State.SKIPPED:
            return True
        return frame.state is _State.SYNTHESISED and self._encode_at(frame) <= now

    def _encode_at(self, frame: _Frame) -> float:
        return frame.job.deadline - self._encode_ahead if frame.job.deadline else 0.0

    def _synthesise_at(self, frame: _Frame) -> float:
        return frame.job.deadline - self._look_ahead if frame.job.deadline else 0.0

    def _late(self, frame: _Frame, now: float) -> bool:
        return now - frame.due > self._drop_late


class OrderedPool:
    """Worker threads that make and encode the frames of all lanes, the earliest deadline first.

    Args:
        workers: number of threads.
        clock: seconds; the clock of all deadlines.
        trace: called with the name of a step and its lane outside all locks ("synthesised", "try failed", "drained",
            "unlocked"); lets a test hold a worker at one of the places where order matters.
    """

    def __init__(
        self,
        workers: int,
        clock: Callable[[], float] = time.monotonic,
        *,
        trace: Callable[[str, Lane], None] = lambda _step, _lane: None,
    ) -> None:
        if workers < 1:
            raise ValueError(f"a pool needs at least one worker, not {workers}")
        self.clock = clock
        self._trace = trace
        self._mutex = threading.Lock()  # LOCK(A), of all lanes; also guards B, P and the counters
        self._work = threading.Condition(self._mutex)  # something to do, or another release time
        self._settled = threading.Condition(self._mutex)  # a lane has become quiet
        self._lanes: list[Lane] = []
        self._alarm = math.inf  # the earliest time at which a sleeping worker will look again
        self._turn = 0
        self._closed = False
        self._threads = [
            threading.Thread(target=self._worker, name=f"mary-pool-{n}", daemon=True) for n in range(workers)
        ]
        for thread in self._threads:
            thread.start()

    def open(
        self,
        synthesise: Callable[[FrameJob], Picture],
        encode: Callable[[FrameJob, Picture], None],
        *,
        look_ahead: float = math.inf,
        encode_ahead: float = math.inf,
        drop_late: float = math.inf,
        on_drop: Callable[[FrameJob], None] | None = None,
        on_error: Callable[[BaseException], None] | None = None,
    ) -> Lane:
        """Add a stream.

        Args:
            synthesise: makes the picture of a job; called on several workers at once.
            encode: takes the picture; called in order of index, one at a time.
            look_ahead: seconds before its deadline at which a frame may be synthesised.
            encode_ahead: seconds before its deadline at which a frame may be encoded.
            drop_late: seconds after its deadline at which a frame is skipped.
            on_drop: called in order with every frame that is skipped, late or failed (not with discarded ones).
            on_error: called with every error of the two callables; the lane goes on unless this closes it.
                Without it the first error closes the lane and is raised by `wait`.

        Raises:
            RuntimeError: the pool is closed.
        """
        lane = Lane(self, synthesise, encode, look_ahead, encode_ahead, drop_late, on_drop, on_error)
        with self._mutex:
            if self._closed:
                raise RuntimeError("the pool is closed")
            self._lanes.append(lane)
        return lane

    def close(self) -> None:
        """Abandon all lanes and end the threads; returns when they have ended."""
        with self._mutex:
            self._closed = True
            lanes = list(self._lanes)
            self._work.notify_all()
        for lane in lanes:
            lane.close()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join()

    def look_again(self) -> None:
        """Wake a worker because the clock was moved by hand."""
        with self._mutex:
            self._work.notify()

    def _worker(self) -> None:
        # Figure 4-4.
        while self._work_once():
            pass

    def _work_once(self) -> bool:
        # In a frame of its own, so that a worker that waits keeps nothing of the lane it last worked for.
        task = self._grab()
        if task is None:
            return False
        lane, frame = task
        if frame is not None:
            self._synthesise(lane, frame)
        self._drain(lane)
        self._leave(lane)
        return True

    def _grab(self) -> tuple[Lane, _Frame | None] | None:
        # The work with the earliest deadline over all lanes: a frame of A to synthesise, or None if P is ready.
        with self._mutex:
            while not self._closed:
                now = self.clock()
                task, release = self._earliest(now)
                if task is not None:
                    lane = task.lane
                    self._turn += 1
                    lane._served = self._turn
                    lane._running += 1
                    self._work.notify()  # one more worker looks, and keeps the time if there is nothing to do
                    if task.encode:
                        return lane, None
                    frame = lane._unsynthesised.popleft()
                    frame.state = _State.TAKEN
                    lane._buffered += 1
                    return lane, frame
                if release < self._alarm:
                    self._alarm = release
                    self._work.wait(release - now)
                    if self._alarm == release:
                        self._alarm = math.inf
                else:
                    self._work.wait()
            return None

    def _earliest(self, now: float) -> tuple[_Task | None, float]:
        # The most urgent thing to do now, if there is any, and otherwise when the next one will be released.
        best: _Task | None = None
        release = math.inf
        for lane in self._lanes:
            if not lane._order:
                continue
            task: _Task | None = None
            first = lane._order[0]
            if lane._encoder.locked():
                pass  # its holder looks again after UNLOCK, so P is not forgotten
            elif lane._ready(now):
                task = _Task(lane, True, first.due)
            elif first.state is _State.SYNTHESISED:
                release = min(release, lane._encode_at(first))
            if task is None and lane._unsynthesised and lane._buffered < BUFFERED_FRAMES:
                frame = lane._unsynthesised[0]
                if lane._synthesise_at(frame) <= now:
                    task = _Task(lane, False, frame.due)
                else:
                    release = min(release, lane._synthesise_at(frame))
            if task is not None and (best is None or (task.due, lane._served) < (best.due, best.lane._served)):
                best = task
        return best, release

    def _synthesise(self, lane: Lane, frame: _Frame) -> None:
        picture: Picture | None = None
        if not lane._late(frame, self.clock()):
            try:
                picture = lane._synthesise(frame.job)
            except BaseException as error:
                self._report(lane, error)
        with self._mutex:  # put F into B
            if frame.state is _State.TAKEN:
                frame.picture = picture
                frame.state = _State.SKIPPED if picture is None else _State.SYNTHESISED
                lane._buffered -= picture is None
        self._trace("synthesised", lane)

    def _drain(self, lane: Lane) -> None:
        while self._may_encode(lane):
            if not lane._encoder.acquire(blocking=False):  # TRYLOCK(P)
                self._trace("try failed", lane)
                return
            try:
                while (frame := self._advance(lane)) is not None:  # encoding state
                    self._encode(lane, frame)
                self._trace("drained", lane)
            finally:
                lane._encoder.release()  # UNLOCK(P)
            self._trace("unlocked", lane)

    def _may_encode(self, lane: Lane) -> bool:
        with self._mutex:
            return self._first(lane) is not None

    def _first(self, lane: Lane) -> _Frame | None:
        # With the mutex: the frame P points to, if it can be encoded now and no other lane has an earlier deadline.
        now = self.clock()
        if not lane._ready(now):
            return None
        frame = lane._order[0]
        if len(self._lanes) > 1:
            task, _ = self._earliest(now)
            if task is not None and task.lane is not lane and task.due < frame.due:
                return None
        return frame

    def _advance(self, lane: Lane) -> _Frame | None:
        # P points to a synthesised frame: take it out of B and move P forward.
        with self._mutex:
            frame = self._first(lane)
            if frame is None:
                return None
            lane._order.popleft()
            lane._passed = frame.job.index
            if frame.state is _State.SYNTHESISED:
                lane._buffered -= 1
                self._work.notify()  # B has room again
            return frame

    def _encode(self, lane: Lane, frame: _Frame) -> None:
        picture = frame.picture
        encoded = False
        try:
            if picture is not None and not lane._late(frame, self.clock()):
                lane._encode(frame.job, picture)
                encoded = True
        except BaseException as error:
            self._report(lane, error)
        frame.picture = None
        with self._mutex:
            lane.encoded += encoded
            lane.dropped += not encoded
        if not encoded and lane._on_drop is not None:
            try:
                lane._on_drop(frame.job)
            except BaseException as error:
                self._report(lane, error)

    def _report(self, lane: Lane, error: BaseException) -> None:
        if lane._on_error is None:
            with self._mutex:
                lane.error = lane.error or error
            lane.close()
            return
        try:
            lane._on_error(error)
        except BaseException:
            _log.exception("on_error of a lane failed")

    def _leave(self, lane: Lane) -> None:
        with self._mutex:
            lane._running -= 1
            self._settle(lane)

    def _settle(self, lane: Lane) -> None:
        # With the mutex: tell those who wait for a lane that has become quiet, and let a finished one go.
        if lane._order or lane._running:
            return
        self._settled.notify_all()
        if lane._finished and lane in self._lanes:
            self._lanes.remove(lane)
