from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from app.engine.training.workers import cores, in_parallel
from app.errors import TrainingStopped

HERE = Path(__file__).parent


def square(number: int, *, more: int = 0) -> tuple[int, int]:
    time.sleep(0.02 * (3 - number % 4))  # later ones are ready first
    return number * number + more, os.getpid()


def die(number: int) -> int:
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die_before_reading_on(_: bytes) -> None:
    time.sleep(0.2)
    os.kill(os.getpid(), signal.SIGKILL)


def fail(number: int) -> int:
    if number == 2:
        raise TrainingStopped(f"number {number} is broken", advice="Mend it.")
    return number


def threads(_: int) -> tuple[int, int]:
    import cv2
    from threadpoolctl import threadpool_info

    return cv2.getNumThreads(), max([pool["num_threads"] for pool in threadpool_info()], default=1)


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.timeout(60)
def test_items_that_nobody_reads_any_more_hold_up_nothing() -> None:
    large = [bytes(20_000_000)] * 6  # far more than a pipe holds
    with pytest.raises(TrainingStopped):
        list(in_parallel(die_before_reading_on, large, workers=2))


def test_results_come_in_the_order_of_the_items() -> None:
    shares: list[float] = []
    results = list(in_parallel(partial(square, more=5), range(9), workers=2, progress=shares.append))
    assert [number for number, _ in results] == [n * n + 5 for n in range(9)]
    pids = {pid for _, pid in results}
    assert os.getpid() not in pids
    assert len(pids) <= 2
    assert not any(alive(pid) for pid in pids)
    assert shares == pytest.approx([(n + 1) / 9 for n in range(9)])


@pytest.mark.parametrize(("items", "workers"), [(range(4), 1), (range(1), 0), (range(0), 0)])
def test_one_worker_or_one_item_needs_no_other_process(items: range, workers: int) -> None:
    shares: list[float] = []
    results = list(in_parallel(square, items, workers=workers, progress=shares.append))
    assert results == [(n * n, os.getpid()) for n in items]
    assert len(shares) == len(items)


def test_workers_start_no_threads() -> None:
    assert set(in_parallel(threads, range(2), workers=2)) == {(1, 1)}


def test_a_killed_worker_ends_the_training_with_advice() -> None:
    with pytest.raises(TrainingStopped, match="a process of the training was killed") as raised:
        list(in_parallel(die, range(6), workers=2))
    assert "memory" in raised.value.advice


@pytest.mark.parametrize("workers", [1, 2])
def test_what_goes_wrong_in_a_worker_comes_out_as_it_is(workers: int) -> None:
    results = in_parallel(fail, range(5), workers=workers)
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(TrainingStopped, match="number 2 is broken") as raised:
        next(results)
    assert raised.value.advice == "Mend it."


def test_processes_end_with_who_does_not_want_all_results() -> None:
    results = in_parallel(square, range(50), workers=2)
    first = next(results)
    results.close()  # type: ignore[attr-defined]
    assert not alive(first[1])


def sleep(number: int) -> int:
    if number:
        time.sleep(60)
    return number


def sleepers() -> None:
    try:
        for _ in in_parallel(sleep, range(4), workers=2):
            print("started", flush=True)
    except KeyboardInterrupt:
        print("interrupted", flush=True)


def test_an_interrupt_from_the_keyboard_ends_all_at_once() -> None:
    """The terminal sends it to every process of the group."""
    program = f"import sys; sys.path.insert(0, {str(HERE)!r}); import test_workers; test_workers.sleepers()"
    process = subprocess.Popen(
        [sys.executable, "-c", program], cwd=HERE.parents[2], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "started\n"
        time.sleep(0.3)
        began = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)
        output, errors = process.communicate(timeout=20)
        assert output == "interrupted\n"
        assert "Traceback" not in errors
        assert time.monotonic() - began < 5
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def test_cores_are_those_that_may_be_used() -> None:
    assert 1 <= cores() <= (os.cpu_count() or 1)
