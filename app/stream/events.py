"""What happens to a stream, told to whoever listens."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from app.stream.seats import Seats

QUEUED_EVENTS = 256
"""Events kept for a listener that does not read; the oldest is forgotten."""


@dataclass(frozen=True, slots=True)
class Event:
    """One event: `state`, `speak_started`, `speak_ended` or `error`, and its data."""

    name: str
    data: dict[str, Any] = field(default_factory=dict)


class EventBoard:
    """Hands every event to every listener. On one event loop.

    Args:
        seats: for the listeners.
    """

    def __init__(self, seats: Seats) -> None:
        self._seats = seats
        self._listeners: set[asyncio.Queue[Event | None]] = set()
        self._closed = False

    def post(self, event: Event) -> None:
        """Tell all listeners; never blocks."""
        for queue in self._listeners:
            _put(queue, event)

    def close(self) -> None:
        """End all listeners' iterations after what is queued."""
        self._closed = True
        for queue in self._listeners:
            _put(queue, None)

    def listen(self, first: Callable[[], Iterable[Event]]) -> AsyncIterator[Event]:
        """Every event from the first iteration on, until the board is closed; `first` makes those to begin with.

        Raises:
            OverCapacity: there are too many listeners, now or when the iteration begins.
        """
        self._seats.check()
        return self._listen(first)

    async def _listen(self, first: Callable[[], Iterable[Event]]) -> AsyncIterator[Event]:
        queue: asyncio.Queue[Event | None] = asyncio.Queue(QUEUED_EVENTS)
        for event in first():
            queue.put_nowait(event)
        if self._closed:
            queue.put_nowait(None)
        with self._seats.one():
            self._listeners.add(queue)
            try:
                while (event_or_end := await queue.get()) is not None:
                    yield event_or_end
            finally:
                self._listeners.discard(queue)


def _put(queue: asyncio.Queue[Event | None], event: Event | None) -> None:
    if queue.full():
        queue.get_nowait()
    queue.put_nowait(event)
