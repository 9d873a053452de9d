"""Fan-out: worker threads publish once, every viewer reads at its own pace from a bounded queue.

What happens when a viewer is too slow: its queue is cut to the newest key frame in it, or emptied until the next one
comes. When that happens again and again the viewer is disconnected, since what is shared cannot adapt to one viewer.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Collection
from typing import Generic, Protocol, TypeVar

MAX_ITEMS = 4_096  # bound of every queue, should time stamps stand still
MAX_CUTS = 3  # a viewer cut this often ...
CUT_SECONDS = 30.0  # ... within this time of the stream is disconnected


class Item(Protocol):
    """What can be broadcast: packets, and chunks of a container format."""

    @property
    def kind(self) -> str:
        """What subscribers choose by. Items of kind "header" are kept, and come first for every subscriber."""

    @property
    def seconds(self) -> float:
        """Time on the stream's clock, by which queues are bounded."""

    @property
    def starts(self) -> bool:
        """A viewer can start here: a key frame."""


T = TypeVar("T", bound=Item)


class Subscription(Generic[T]):
    """One viewer's bounded queue: an asynchronous iterator and a context manager that closes it.

    It ends when the broadcast is closed (after what is queued), when `close` is called, or when the viewer is too slow.

    Attributes:
        cuts: how often it was cut to a key frame for being too slow.
        slow: it was disconnected for being too slow.
    """

    def __init__(self, owner: Broadcast[T], kinds: frozenset[str] | None, seconds: float) -> None:
        self.cuts = 0
        self.slow = False
        self._owner = owner
        self._kinds = kinds
        self._seconds = seconds
        self._loop = asyncio.get_running_loop()
        self._lock = owner._lock
        self._headers: deque[T] = deque()
        self._queue: deque[T] = deque()
        self._pictures = kinds is None or "video" in kinds  # sound alone can start anywhere
        self._waiting_for_start = self._pictures
        self._cut_times: deque[float] = deque(maxlen=MAX_CUTS)
        self._ended = False
        self._waiter: asyncio.Future[None] | None = None

    def close(self) -> None:
        """Stop at once; also ends an iteration that waits. Idempotent, from the event loop."""
        with self._lock:
            self._abandon()
            self._owner._forget_ended()

    def __enter__(self) -> Subscription[T]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __aiter__(self) -> Subscription[T]:
        return self

    async def __anext__(self) -> T:
        while True:
            with self._lock:
                if self._headers:
                    return self._headers.popleft()
                if self._queue:
                    return self._queue.popleft()
                if self._ended:
                    raise StopAsyncIteration
                waiter = self._waiter = self._loop.create_future()
            await waiter

    # The rest is called with the broadcast's lock held, from any thread.

    def _begin(self, headers: Collection[T], cache: Collection[T]) -> None:
        self._headers.extend(headers)
        if self._pictures and cache:
            self._queue.extend(item for item in cache if self._wants(item))
            # The backlog is what the viewer was given, not how far it is behind.
            self._seconds += self._queue[-1].seconds - self._queue[0].seconds
            self._waiting_for_start = False

    def _wants(self, item: T) -> bool:
        return self._kinds is None or item.kind in self._kinds

    def _put(self, item: T) -> None:
        if self._ended:
            return
        if item.kind == "header":
            self._headers.append(item)
        elif not self._wants(item) or (self._waiting_for_start and not item.starts):
            return
        else:
            self._waiting_for_start = False
            self._queue.append(item)
            if len(self._queue) > MAX_ITEMS or item.seconds - self._queue[0].seconds > self._seconds:
                self._cut(item.seconds)
        self._wake()

    def _cut(self, now: float) -> None:
        self.cuts += 1
        self._cut_times.append(now)
        if len(self._cut_times) == MAX_CUTS and now - self._cut_times[0] < CUT_SECONDS:
            self.slow = True
            self._abandon()
            return
        newest = max((place for place, item in enumerate(self._queue) if item.starts), default=0)
        # A newest key frame at the very front means that what follows it alone is too much.
        kept = list(self._queue)[newest:] if newest else []
        self._queue = deque(kept)
        self._waiting_for_start = self._pictures and not kept

    def _abandon(self) -> None:
        self._headers.clear()
        self._queue.clear()
        self._end()

    def _end(self) -> None:
        self._ended = True
        self._wake()

    def _wake(self) -> None:
        waiter, self._waiter = self._waiter, None
        if waiter is None:
            return
        try:
            self._loop.call_soon_threadsafe(_resolve, waiter)
        except RuntimeError:  # the viewer's event loop is gone, and the viewer with it
            self._ended = True


class Broadcast(Generic[T]):
    """One source, any number of subscribers. `publish` and `close` may be called from any thread and never block.

    The items since the last key frame are kept, so that a late viewer sees a whole picture at once.

    Args:
        queue_seconds: a subscriber this far behind is cut to the next key frame.
        cache_seconds: a group of pictures longer than this is not kept: the stream has been sending sound only, and
            the picture shown last is no place to start. To be longer than the distance between key frames.
    """

    def __init__(self, queue_seconds: float = 4.0, cache_seconds: float = 10.0) -> None:
        self._queue_seconds = queue_seconds
        self._cache_seconds = cache_seconds
        self._lock = threading.RLock()
        self._headers: list[T] = []
        self._cache: deque[T] = deque()
        self._subscriptions: list[Subscription[T]] = []
        self._closed = False

    @property
    def subscribers(self) -> int:
        """How many are connected now."""
        return len(self._subscriptions)

    @property
    def closed(self) -> bool:
        """`close` has been called."""
        return self._closed

    def publish(self, item: T) -> None:
        """Hand `item` to every subscriber that wants it. After `close` nothing happens."""
        with self._lock:
            if self._closed:
                return
            self._remember(item)
            for subscription in self._subscriptions:
                subscription._put(item)
            self._forget_ended()

    def subscribe(self, kinds: Collection[str] | None = None, *, backlog: bool = True) -> Subscription[T]:
        """A new viewer; to be called on its event loop.

        Args:
            kinds: kinds of items to receive, all when None. Sound without "video" starts with the next item.
            backlog: start with the cached group of pictures; otherwise, or when there is none, with the next key frame
                and nothing before it.
        """
        with self._lock:
            subscription = Subscription(self, None if kinds is None else frozenset(kinds), self._queue_seconds)
            subscription._begin(self._headers, self._cache if backlog else ())
            if self._closed:
                subscription._end()
            else:
                self._subscriptions.append(subscription)
            return subscription

    def close(self) -> None:
        """End all: subscribers get what is queued and then the end of their iteration. Idempotent."""
        with self._lock:
            self._closed = True
            self._cache.clear()
            for subscription in self._subscriptions:
                subscription._end()
            self._forget_ended()

    def _remember(self, item: T) -> None:
        if item.kind == "header":
            self._headers.append(item)
            return
        if item.starts:
            self._cache.clear()
        elif not self._cache:
            return
        self._cache.append(item)
        if len(self._cache) > MAX_ITEMS or item.seconds - self._cache[0].seconds > self._cache_seconds:
            self._cache.clear()

    def _forget_ended(self) -> None:
        if any(each._ended for each in self._subscriptions):
            self._subscriptions = [each for each in self._subscriptions if not each._ended]


def _resolve(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)
