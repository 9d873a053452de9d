from __future__ import annotations

import asyncio

import pytest

from app.api.turns import Turns
from app.errors import OverCapacity


async def test_some_work_some_wait_and_the_rest_is_refused() -> None:
    turns = Turns(at_once=2, waiting=1)
    leave = asyncio.Event()
    working = 0

    async def work() -> None:
        nonlocal working
        async with turns:
            working += 1
            await leave.wait()

    tasks = [asyncio.create_task(work()) for _ in range(3)]
    await asyncio.sleep(0)
    assert working == 2
    with pytest.raises(OverCapacity):
        await work()
    leave.set()
    await asyncio.gather(*tasks)
    assert working == 3
    await work()


async def test_who_goes_while_waiting_gives_the_place_back() -> None:
    turns = Turns(at_once=1, waiting=1)
    async with turns:
        waiting = asyncio.create_task(turns.__aenter__())
        await asyncio.sleep(0)
        waiting.cancel()
        await asyncio.gather(waiting, return_exceptions=True)
        another = asyncio.create_task(turns.__aenter__())
        await asyncio.sleep(0)
        assert not another.done()
    await another
    await turns.__aexit__(None, None, None)
