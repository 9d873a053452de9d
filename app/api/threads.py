"""Blocking work beside the event loop, in threads that never hold up the end of the process.

`asyncio.to_thread` will not do here: its pool is joined when the process ends, so loading a model or rendering a file
would keep Ctrl-C waiting, and long renders would take the pool's few threads from short work.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


async def in_thread(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Run `function` in a daemon thread of its own and return what it returns, or raise what it raises.

    Cancelling the wait does not stop the thread; what `function` does must be told in another way.
    """
    loop = asyncio.get_running_loop()
    outcome: asyncio.Future[T] = loop.create_future()

    def deliver(result: T | None, error: BaseException | None) -> None:
        if outcome.done():  # the wait was cancelled
            return
        if error is not None:
            outcome.set_exception(error)
        else:
            outcome.set_result(result)  # type: ignore[arg-type]

    def run() -> None:
        result: T | None = None
        error: BaseException | None = None
        try:
            result = function(*args, **kwargs)
        except BaseException as raised:
            error = raised
        with contextlib.suppress(RuntimeError):  # the loop has been closed meanwhile: nobody waits
            loop.call_soon_threadsafe(deliver, result, error)

    threading.Thread(target=run, name=f"background-{getattr(function, '__name__', 'work')}", daemon=True).start()
    return await outcome
