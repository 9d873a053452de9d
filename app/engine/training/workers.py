"""Work on many items at once, one process a core: decoding and tracking hold Python's lock too often for threads."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from app.engine.threads import one_thread_a_call
from app.errors import TrainingStopped

Item = TypeVar("Item")
Result = TypeVar("Result")


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def in_parallel(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    workers: int = 0,
    progress: Callable[[float], None] = lambda _: None,
) -> Iterator[Result]:
    """Results of `work` in the order of the items, each in one of some processes.

    Args:
        work: a function of a module, or a `functools.partial` of one.
        items: and results travel between processes: small ones are better.
        workers: processes; 0 for one a core, 1 does everything in this one.
        progress: told the share done.

    Raises:
        TrainingStopped: a process was killed, as happens when memory runs out.
    """
    count = min(workers or cores(), len(items))
    if count <= 1:
        for number, item in enumerate(items):
            yield work(item)
            progress((number + 1) / len(items))
        return
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), initializer=_prepare)
    try:
        results = pool.map(work, items)
        _leave_reading_to_the_workers(pool)
        for number, result in enumerate(results):
            yield result
            progress((number + 1) / len(items))
    except BrokenProcessPool as error:
        raise TrainingStopped(
            "a process of the training was killed", advice="If memory ran out, give it more or fewer workers."
        ) from error
    finally:
        _leave_reading_to_the_workers(pool)
        pool.shutdown(wait=True, cancel_futures=True)


def _leave_reading_to_the_workers(pool: ProcessPoolExecutor) -> None:
    """Close this process's copy of the end at which workers read items; to be called when all of them are submitted.

    Where all workers are dead, sending an item then fails. Python 3.11.2, which is Debian's, would otherwise wait for a
    reader for ever (CPython's issue 94777); later ones do this themselves once they have seen a worker die.
    """
    pool._call_queue._reader.close()  # type: ignore[attr-defined]


def _prepare() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C reaches every process: end at once and say nothing
    one_thread_a_call()
