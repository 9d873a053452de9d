"""How many may watch at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from app.errors import OverCapacity


class Seats:
    """A number of places, some of them taken. On one event loop.

    Args:
        limit: how many there are.
        what: for the message to whoever finds none, "viewers of this stream".
    """

    def __init__(self, limit: int, what: str) -> None:
        self.taken = 0
        self._limit = limit
        self._what = what

    def check(self, wanted: int = 1) -> None:
        """Raise OverCapacity if not so many are free."""
        if self.taken + wanted > self._limit:
            raise OverCapacity(f"there are {self._limit} {self._what}", advice="Try again when one has gone.")

    @contextmanager
    def one(self) -> Iterator[None]:
        """Take a seat for as long as this is open.

        Raises:
            OverCapacity: none is free.
        """
        self.check()
        self.taken += 1
        try:
            yield
        finally:
            self.taken -= 1
