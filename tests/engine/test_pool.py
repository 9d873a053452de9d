from __future__ import annotations

import gc
import math
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.engine.frame import Picture
from app.engine.pool import BUFFERED_FRAMES, FrameJob, Lane, OrderedPool

PATIENCE = 20.0


def picture_of(job: FrameJob) -> Picture:
    return np.full(1, job.index % 256, np.uint8)


class Recorder:
    """Keeps what was encoded and dropped, and checks that a lane's calls never overlap."""

    def __init__(self) -> None:
        self.encoded: list[int] = []
        self.dropped: list[int] = []
        self.order: list[int] = []
        self._alone = threading.Lock()

    def encode(self, job: FrameJob, picture: Picture) -> None:
        assert self._alone.acquire(blocking=False), "two workers in the encoding state"
        assert picture[0] == job.index % 256
        self.encoded.append(job.index)
        self.order.append(job.index)
        self._alone.release()

    def drop(self, job: FrameJob) -> None:
        assert self._alone.acquire(blocking=False)
        self.dropped.append(job.index)
        self.order.append(job.index)
        self._alone.release()


class ManualClock:
    def __init__(self) -> None:
        self.now = 1000.0
        self.pool: OrderedPool | None = None

    def __call__(self) -> float:
        return self.now

    def set(self, now: float) -> None:
        self.now = now
        assert self.pool is not None
        self.pool.look_again()


@contextmanager
def pool_of(workers: int, **options: object) -> Iterator[OrderedPool]:
    pool = OrderedPool(workers, **options)  # type: ignore[arg-type]
    clock = options.get("clock")
    if isinstance(clock, ManualClock):
        clock.pool = pool
    try:
        yield pool
    finally:
        pool.close()
        assert not any(thread.is_alive() for thread in pool._threads)


def jobs(first: int, last: int, deadline: float = 0.0, step: float = 0.0) -> list[FrameJob]:
    return [FrameJob(n, deadline + step * (n - first) if deadline else 0.0, None) for n in range(first, last)]


def until(condition: object) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end, "never happened"
        time.sleep(0.001)


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_every_frame_is_encoded_once_and_in_order(workers: int) -> None:
    recorder = Recorder()
    with pool_of(workers) as pool:
        lane = pool.open(picture_of, recorder.encode)
        lane.submit(jobs(0, 300))
        lane.submit(jobs(300, 400))
        lane.finish()
        assert lane.wait(PATIENCE)
        assert (lane.encoded, lane.dropped, lane.pending) == (400, 0, 0)
        assert pool._lanes == []
    assert recorder.encoded == list(range(400))


def test_the_interleaving_that_strands_a_frame_in_the_printed_figure() -> None:
    # One worker has drained B and is about to UNLOCK(P); just then the other puts its frame into B and fails TRYLOCK.
    failed = threading.Event()
    first_drained = threading.Event()
    holders: list[int] = []
    steps: list[tuple[str, int]] = []

    def trace(step: str, _lane: Lane) -> None:
        steps.append((step, threading.get_ident()))
        if step == "drained" and not first_drained.is_set():
            first_drained.set()
            assert failed.wait(PATIENCE)
        if step == "try failed":
            failed.set()

    def synthesise(job: FrameJob) -> Picture:
        if job.index == 1:
            assert first_drained.wait(PATIENCE)
        return picture_of(job)

    def encode(_job: FrameJob, _picture: Picture) -> None:
        holders.append(threading.get_ident())

    with pool_of(2, trace=trace) as pool:
        lane = pool.open(synthesise, encode)
        lane.submit(jobs(0, 2))
        assert lane.wait(PATIENCE)
        assert lane.encoded == 2
    holder = next(ident for step, ident in steps if step == "drained")
    failing = next(ident for step, ident in steps if step == "try failed")
    assert holder != failing
    assert holders == [holder, holder]  # the holder looked again after UNLOCK


def test_a_worker_that_fails_trylock_goes_on_synthesising() -> None:
    inside = threading.Event()
    let_go = threading.Event()
    made: list[int] = []

    def synthesise(job: FrameJob) -> Picture:
        made.append(job.index)
        return picture_of(job)

    def encode(job: FrameJob, _picture: Picture) -> None:
        if job.index == 0:
            inside.set()
            assert let_go.wait(PATIENCE)

    with pool_of(2) as pool:
        lane = pool.open(synthesise, encode)
        lane.submit(jobs(0, 200))
        assert inside.wait(PATIENCE)
        until(lambda: len(made) == BUFFERED_FRAMES + 1)  # frame 0 is in the encoder, B is full
        let_go.set()
        assert lane.wait(PATIENCE)
    assert sorted(made) == list(range(200))


def test_look_ahead_and_encode_ahead_hold_frames_back() -> None:
    clock = ManualClock()
    recorder = Recorder()
    made: list[int] = []

    def synthesise(job: FrameJob) -> Picture:
        made.append(job.index)
        return picture_of(job)

    with pool_of(2, clock=clock) as pool:
        lane = pool.open(synthesise, recorder.encode, look_ahead=0.4, encode_ahead=0.08)
        lane.submit(jobs(0, 20, deadline=1001.0, step=0.04))
        time.sleep(0.02)
        assert made == []
        clock.set(1000.7)
        until(lambda: sorted(made) == [0, 1, 2])
        assert recorder.encoded == []
        clock.set(1000.93)
        until(lambda: recorder.encoded == [0])
        until(lambda: sorted(made) == list(range(9)))
        clock.set(1000.97)
        until(lambda: recorder.encoded == [0, 1])
        clock.set(1001.9)
        assert lane.wait(PATIENCE)
    assert recorder.encoded == list(range(20))


def test_the_earliest_deadline_over_all_lanes_goes_first() -> None:
    clock = ManualClock()
    order: list[tuple[str, int]] = []
    gate = threading.Event()

    def block(_job: FrameJob) -> Picture:
        assert gate.wait(PATIENCE)
        return np.zeros(1, np.uint8)

    with pool_of(1, clock=clock) as pool:
        pool.open(block, lambda _job, _picture: None).submit(jobs(0, 1))
        lanes = {}
        for name, start in (("a", 1000.10), ("b", 1000.02), ("file", 0.0)):
            lanes[name] = pool.open(
                picture_of,
                lambda job, _picture, name=name: order.append((name, job.index)),
                look_ahead=9,
                encode_ahead=9,
            )
            lanes[name].submit(jobs(0, 3, deadline=start, step=0.04))
        gate.set()
        for lane in lanes.values():
            assert lane.wait(PATIENCE)
    # deadlines: b .02 .06 .10, a .10 .14 .18, then the file
    assert [item for item in order if item[0] != "file"][:2] == [("b", 0), ("b", 1)]
    assert sorted(order[2:4]) == [("a", 0), ("b", 2)]
    assert order[4:] == [("a", 1), ("a", 2), ("file", 0), ("file", 1), ("file", 2)]


def test_the_drain_gives_way_after_each_frame() -> None:
    clock = ManualClock()
    order: list[tuple[str, int]] = []
    with pool_of(1, clock=clock) as pool:
        live: Lane | None = None

        def encode_slow(job: FrameJob, _picture: Picture) -> None:
            order.append(("slow", job.index))
            if job.index == 1:  # while it drains, a frame of the other lane becomes due
                assert live is not None
                live.submit(jobs(0, 1, deadline=1000.5))

        slow = pool.open(picture_of, encode_slow, encode_ahead=0.1)
        live = pool.open(picture_of, lambda job, _picture: order.append(("live", job.index)))
        slow.submit(jobs(0, 5, deadline=1002.0, step=0.01))
        until(lambda: slow._buffered == 5)  # all in B, not yet released
        clock.set(1001.99)
        assert slow.wait(PATIENCE)
        assert live.wait(PATIENCE)
    assert order == [("slow", 0), ("slow", 1), ("live", 0), ("slow", 2), ("slow", 3), ("slow", 4)]


def test_lanes_without_deadlines_take_turns() -> None:
    made: list[str] = []
    gate = threading.Event()

    def synthesise(job: FrameJob) -> Picture:
        made.append(job.payload)
        return picture_of(job)

    def block(job: FrameJob) -> Picture:
        assert gate.wait(PATIENCE)
        return picture_of(job)

    with pool_of(1) as pool:
        pool.open(block, Recorder().encode).submit(jobs(0, 1))
        lanes = {name: pool.open(synthesise, Recorder().encode) for name in "abc"}
        for name, lane in lanes.items():
            lane.submit(FrameJob(n, 0.0, name) for n in range(10))
        gate.set()
        assert all(lane.wait(PATIENCE) for lane in lanes.values())
    for turn in range(0, 30, 3):
        assert sorted(made[turn : turn + 3]) == ["a", "b", "c"]


def test_late_frames_are_skipped_in_order_and_do_not_block() -> None:
    clock = ManualClock()
    recorder = Recorder()
    with pool_of(2, clock=clock) as pool:
        lane = pool.open(picture_of, recorder.encode, drop_late=0.1, on_drop=recorder.drop)
        clock.set(1010.0)
        lane.submit(jobs(0, 10, deadline=1009.7, step=0.04))  # due at 1009.70, .74 ... 1010.06
        assert lane.wait(PATIENCE)
        assert (lane.encoded, lane.dropped) == (5, 5)
    assert recorder.dropped == [0, 1, 2, 3, 4]
    assert recorder.order == list(range(10))


def test_a_frame_that_is_synthesised_too_late_is_not_encoded() -> None:
    clock = ManualClock()
    recorder = Recorder()

    def synthesise(job: FrameJob) -> Picture:
        clock.now = 1001.0
        return picture_of(job)

    with pool_of(1, clock=clock) as pool:
        lane = pool.open(synthesise, recorder.encode, drop_late=0.5, on_drop=recorder.drop)
        lane.submit(jobs(0, 1, deadline=1000.1))
        assert lane.wait(PATIENCE)
    assert recorder.dropped == [0]
    assert recorder.encoded == []


def test_discard_takes_back_what_is_not_encoded_and_frees_the_indices() -> None:
    started = threading.Event()
    let_go = threading.Event()
    pictures: list[tuple[int, str]] = []

    def synthesise(job: FrameJob) -> Picture:
        if job.payload == "old" and job.index == 2:
            started.set()
            assert let_go.wait(PATIENCE)
        return np.frombuffer(job.payload.encode(), np.uint8)

    def encode(job: FrameJob, picture: Picture) -> None:
        pictures.append((job.index, picture.tobytes().decode()))

    with pool_of(2) as pool:
        lane = pool.open(synthesise, encode)
        lane.submit([FrameJob(n, 0.0, "old") for n in range(6)])
        assert started.wait(PATIENCE)
        until(lambda: len(pictures) == 2 and lane._buffered == 4)  # 3, 4, 5 are in B behind frame 2, in synthesis
        assert lane.discard(1) == 4
        assert lane.pending == 0
        lane.submit([FrameJob(n, 0.0, "new") for n in range(2, 5)])
        until(lambda: len(pictures) == 5)
        let_go.set()  # the old picture of frame 2 arrives now and is thrown away
        assert lane.wait(PATIENCE)
        assert lane.encoded == 5
        with pytest.raises(ValueError, match="after frame 4"):
            lane.submit([FrameJob(4, 0.0)])
    assert pictures == [(0, "old"), (1, "old"), (2, "new"), (3, "new"), (4, "new")]


def test_errors_are_reported_and_the_lane_goes_on() -> None:
    errors: list[BaseException] = []
    recorder, other = Recorder(), Recorder()

    def synthesise(job: FrameJob) -> Picture:
        if job.index == 3:
            raise ValueError("cannot draw")
        return picture_of(job)

    def encode(job: FrameJob, picture: Picture) -> None:
        if job.index == 5:
            raise OSError("cannot encode")
        recorder.encode(job, picture)

    with pool_of(2) as pool:
        lane = pool.open(synthesise, encode, on_drop=recorder.drop, on_error=errors.append)
        neighbour = pool.open(picture_of, other.encode)
        lane.submit(jobs(0, 8))
        neighbour.submit(jobs(0, 8))
        assert lane.wait(PATIENCE)
        assert neighbour.wait(PATIENCE)
        assert (lane.encoded, lane.dropped) == (6, 2)
        assert all(thread.is_alive() for thread in pool._threads)
    assert sorted(type(error).__name__ for error in errors) == ["OSError", "ValueError"]
    assert recorder.encoded == [0, 1, 2, 4, 6, 7]
    assert recorder.order == list(range(8))
    assert other.encoded == list(range(8))


def test_without_on_error_the_first_error_closes_the_lane_and_wait_raises_it() -> None:
    def encode(job: FrameJob, _picture: Picture) -> None:
        if job.index == 4:
            raise OSError("disk full")

    with pool_of(2) as pool:
        lane = pool.open(picture_of, encode)
        lane.submit(jobs(0, 100))
        with pytest.raises(OSError, match="disk full"):
            lane.wait(PATIENCE)
        assert lane.encoded == 4
        with pytest.raises(OSError, match="disk full"):
            lane.submit(jobs(100, 101))
        again = pool.open(picture_of, lambda _job, _picture: None)
        again.submit(jobs(0, 3))
        assert again.wait(PATIENCE)


def test_callbacks_that_fail_and_lanes_that_close_themselves_leave_the_workers_alive() -> None:
    with pool_of(1) as pool:

        def fail(_error: BaseException) -> None:
            lane.close()
            raise RuntimeError("on_error is broken too")

        def encode(_job: FrameJob, _picture: Picture) -> None:
            raise OSError

        lane = pool.open(picture_of, encode, on_error=fail)
        lane.submit(jobs(0, 5))
        assert lane.wait(PATIENCE)
        assert lane.dropped == 1
        assert all(thread.is_alive() for thread in pool._threads)


def test_sleeping_workers_do_not_look_until_the_next_release() -> None:
    looks = 0

    def clock() -> float:
        nonlocal looks
        looks += 1
        return time.monotonic()

    with pool_of(4, clock=clock) as pool:
        lane = pool.open(picture_of, lambda _job, _picture: None, look_ahead=0.01, encode_ahead=0.01)
        lane.submit([FrameJob(0, time.monotonic() + 0.3)])
        assert lane.wait(PATIENCE)
        assert lane.encoded == 1
    assert looks < 40


def test_an_earlier_release_wakes_a_worker_that_sleeps_for_a_later_one() -> None:
    with pool_of(3) as pool:
        later = pool.open(picture_of, lambda _job, _picture: None, look_ahead=0.0)
        later.submit([FrameJob(0, time.monotonic() + 3600)])
        until(lambda: pool._alarm < math.inf and len(pool._work._waiters) == 3)  # type: ignore[attr-defined]
        sooner = pool.open(picture_of, lambda _job, _picture: None, look_ahead=0.0)
        sooner.submit([FrameJob(0, time.monotonic() + 0.05)])
        assert sooner.wait(PATIENCE)
        assert later.pending == 1


def test_closing_the_pool_ends_waiting_and_refuses_more() -> None:
    pool = OrderedPool(2)
    lane = pool.open(picture_of, lambda _job, _picture: None)
    lane.submit([FrameJob(0, time.monotonic() + 3600)])
    assert lane.wait(0.0) in (True, False)
    pool.close()
    assert lane.wait(PATIENCE)
    with pytest.raises(RuntimeError):
        pool.open(picture_of, lambda _job, _picture: None)
    with pytest.raises(RuntimeError):
        lane.submit(jobs(1, 2))
    with pytest.raises(ValueError, match="at least one worker"):
        OrderedPool(0)


def test_wait_reports_a_timeout() -> None:
    with pool_of(1) as pool:
        lane = pool.open(picture_of, lambda _job, _picture: None, look_ahead=0.0)
        lane.submit([FrameJob(0, time.monotonic() + 3600)])
        assert not lane.wait(0.01)


pauses = st.lists(st.integers(0, 3), min_size=1, max_size=7)


@settings(max_examples=60, deadline=None)
@given(
    workers=st.integers(1, 4),
    lanes=st.lists(st.lists(st.integers(0, 12), min_size=1, max_size=4), min_size=1, max_size=4),
    synthesis=pauses,
    encoding=pauses,
    live=st.booleans(),
)
def test_random_interleavings_keep_every_lane_whole_and_in_order(
    workers: int, lanes: list[list[int]], synthesis: list[int], encoding: list[int], live: bool
) -> None:
    recorders = [Recorder() for _ in lanes]

    def synthesise(job: FrameJob) -> Picture:
        time.sleep(synthesis[job.index % len(synthesis)] * 2e-4)
        return picture_of(job)

    with pool_of(workers) as pool:
        opened = []
        for recorder in recorders:

            def encode(job: FrameJob, picture: Picture, recorder: Recorder = recorder) -> None:
                time.sleep(encoding[job.index % len(encoding)] * 1e-4)
                recorder.encode(job, picture)

            ahead = 0.01 if live else math.inf
            opened.append(pool.open(synthesise, encode, look_ahead=2 * ahead, encode_ahead=ahead))
        start = time.monotonic()
        for turn in range(max(map(len, lanes))):
            for lane, batches in zip(opened, lanes, strict=True):
                if turn < len(batches):
                    first = sum(batches[:turn])
                    lane.submit(
                        FrameJob(n, start + n * 1e-3 if live else 0.0) for n in range(first, first + batches[turn])
                    )
        for lane in opened:
            lane.finish()
            assert lane.wait(PATIENCE)
    for recorder, batches in zip(recorders, lanes, strict=True):
        assert recorder.encoded == list(range(sum(batches)))


@settings(max_examples=60, deadline=None)
@given(
    workers=st.integers(1, 4),
    cuts=st.lists(st.tuples(st.integers(1, 12), st.integers(0, 10)), min_size=1, max_size=6),
    pause=pauses,
)
def test_random_discards_lose_nothing_and_repeat_nothing(
    workers: int, cuts: list[tuple[int, int]], pause: list[int]
) -> None:
    # As an interruption does it: take back the last frames, submit others under the same indices.
    encoded: list[tuple[int, int]] = []

    def synthesise(job: FrameJob) -> Picture:
        time.sleep(pause[job.index % len(pause)] * 2e-4)
        return np.array([job.payload], np.uint8)

    def encode(job: FrameJob, picture: Picture) -> None:
        encoded.append((job.index, int(picture[0])))

    expected: dict[int, int] = {}
    with pool_of(workers) as pool:
        lane = pool.open(synthesise, encode)
        following = 0
        for version, (count, back) in enumerate(cuts):
            lane.submit(FrameJob(n, 0.0, version) for n in range(following, following + count))
            expected |= dict.fromkeys(range(following, following + count), version)
            following += count
            following -= lane.discard(following - back)
            expected = {n: v for n, v in expected.items() if n < following}
        lane.finish()
        assert lane.wait(PATIENCE)
        assert lane.encoded == following
    assert encoded == sorted(expected.items())


def test_a_waiting_worker_keeps_nothing_of_the_lane_it_last_worked_for() -> None:
    pool = OrderedPool(2)

    class Owner:
        def synthesise(self, job: FrameJob) -> Picture:
            return picture_of(job)

        def encode(self, job: FrameJob, picture: Picture) -> None:
            pass

    try:
        owner = Owner()
        kept = weakref.ref(owner)
        lane = pool.open(owner.synthesise, owner.encode)
        lane.submit(FrameJob(n, 0.0) for n in range(20))
        lane.finish()
        assert lane.wait(PATIENCE)
        del owner, lane
        give_up = time.monotonic() + PATIENCE
        while kept() is not None:  # until the last worker waits again
            assert time.monotonic() < give_up
            gc.collect()
            time.sleep(0.01)
    finally:
        pool.close()
