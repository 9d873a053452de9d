"""How many renders may work and wait: every queue is bounded."""

from __future__ import annotations

import asyncio

from app.errors import OverCapacity


class Turns:
    """Lets some work and some more wait for their turn (`async with`); refuses the rest.

    Args:
        at_once: how many may work at the same time.
        waiting: how many more may wait.

    Raises:
        OverCapacity: on entering, when all places are taken.
    """

    def __init__(self, at_once: int, waiting: int) -> None:
        self._turns = asyncio.Semaphore(at_once)
        self._places = at_once + waiting

    async def __aenter__(self) -> None:
        if self._places == 0:
            raise OverCapacity("too many files are being rendered", advice="Try again in some seconds.")
        self._places -= 1
        try:
            await self._turns.acquire()
        except BaseException:
            self._places += 1
            raise

    async def __aexit__(self, *_: object) -> None:
        self._turns.release()
        self._places += 1
