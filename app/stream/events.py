"""What happens to a stream, told to whoever listens."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Collection, Iterable
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from app.stream.seats import Seats

QUEUED_EVENTS = 256
"""Events kept for a listener that does not read; the oldest is forgotten."""


EventName = Literal["state", "speak_started", "word", "mark", "viseme", "speak_ended", "push", "error"]

EVENT_NAMES: tuple[EventName, ...] = get_args(EventName)


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened, and its data."""

    name: EventName
    data: dict[str, Any] = field(default_factory=dict)


class EventBoard:
    """Hands every event to every listener. On one event loop.

    Args:
        seats: for the listeners.
    """

    def __init__(self, seats: Seats) -> None:
        self._seats = seats
        self._listeners: dict[asyncio.Queue[Event | None], Collection[str]] = {}
        self._closed = False

    def post(self, event: Event) -> None:
        """Tell all listeners; never blocks."""
        for queue, names in self._listeners.items():
            if event.name in names:
                _put(queue, event)

    def close(self) -> None:
        """End all listeners' iterations after what is queued."""
        self._closed = True
        for queue in self._listeners:
            _put(queue, None)

    def listen(
        self, first: Callable[[], Iterable[Event]], names: Collection[str] = EVENT_NAMES
    ) -> AsyncIterator[Event]:
        """Every event from the first iteration on, until the board is closed.

        Args:
            first: makes those to begin with.
            names: of the events wanted.

        Raises:
            OverCapacity: there are too many listeners, now or when the iteration begins.
        """
        self._seats.check()
        return self._listen(first, names)

    async def _listen(self, first: Callable[[], Iterable[Event]], names: Collection[str]) -> AsyncIterator[Event]:
        queue: asyncio.Queue[Event | None] = asyncio.Queue(QUEUED_EVENTS)
        for event in first():
            if event.name in names:
                queue.put_nowait(event)
        if self._closed:
            queue.put_nowait(None)
        with self._seats.one():
            self._listeners[queue] = names
            try:
                while (event_or_end := await queue.get()) is not None:
                    yield event_or_end
            finally:
                del self._listeners[queue]


def _put(queue: asyncio.Queue[Event | None], event: Event | None) -> None:
    if queue.full():
        queue.get_nowait()
    queue.put_nowait(event)
