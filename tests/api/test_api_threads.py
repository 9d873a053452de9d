from __future__ import annotations

import asyncio
import threading

import pytest

from app.api.threads import in_thread


async def test_results_and_errors_come_back() -> None:
    assert await in_thread(divmod, 7, 2) == (3, 1)
    with pytest.raises(ZeroDivisionError):
        await in_thread(divmod, 7, 0)


async def test_the_thread_holds_up_nothing() -> None:
    threads = await in_thread(lambda: (threading.current_thread().daemon, threading.get_ident()))
    assert threads[0]
    assert threads[1] != threading.get_ident()


async def test_a_cancelled_wait_leaves_the_thread_alone() -> None:
    go, done = threading.Event(), threading.Event()

    def work() -> None:
        go.wait(10)
        done.set()

    waiting = asyncio.create_task(in_thread(work))
    await asyncio.sleep(0)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    go.set()
    assert await in_thread(done.wait, 10)


def test_a_loop_that_is_gone_is_no_error() -> None:
    go = threading.Event()

    async def leave() -> threading.Thread:
        before = set(threading.enumerate())
        task = asyncio.create_task(in_thread(go.wait, 10))
        await asyncio.sleep(0)
        task.cancel()
        return next(iter(set(threading.enumerate()) - before))

    thread = asyncio.run(leave())
    go.set()
    thread.join(10)
    assert not thread.is_alive()
