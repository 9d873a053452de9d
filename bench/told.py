"""What a stream tells over its WebSocket, with the time of arrival."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from app.client import Conversation, Event, Stream


class Told:
    """Listens in a thread of its own.

    Attributes:
        events: (Unix time of arrival, event), in order of arrival.
    """

    def __init__(self, conversation: Conversation) -> None:
        self.events: list[tuple[float, Event]] = []
        self._conversation = conversation
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        for event in self._conversation:
            arrived = time.time()
            with self._changed:
                self.events.append((arrived, event))
                self._changed.notify_all()

    def join(self) -> None:
        """Wait until the stream has ended."""
        self._thread.join(30)

    def mark(self) -> int:
        """How many events there are; see `wait`."""
        return len(self.events)

    def wait(self, name: str, since: int, seconds: float = 60.0, **data: Any) -> tuple[float, dict[str, Any]]:
        """Arrival and data of the first event of a name, with some data, after the first `since` events.

        Raises:
            TimeoutError: it did not come.
        """
        give_up = time.monotonic() + seconds
        with self._changed:
            place = since
            while True:
                while place < len(self.events):
                    arrived, event = self.events[place]
                    if event.name == name and data.items() <= event.data.items():
                        return arrived, event.data
                    place += 1
                if not self._changed.wait(max(0.0, give_up - time.monotonic())) and time.monotonic() > give_up:
                    raise TimeoutError(f"no {name!r} came within {seconds} s")

    def of(self, name: str) -> list[tuple[float, dict[str, Any]]]:
        """Arrival and data of all events of a name."""
        return [(arrived, event.data) for arrived, event in list(self.events) if event.name == name]

    def words(self) -> list[tuple[float, dict[str, Any]]]:
        """Arrival and data of the words that were heard."""
        ends = {data["utterance"]: data["media_time"] for _, data in self.of("speak_ended")}
        return [(at, word) for at, word in self.of("word") if word["media_time"] < (ends[word["utterance"]] or 0.0)]


@contextmanager
def conversation(stream: Stream) -> Iterator[tuple[Conversation, Told]]:
    """Talk with a stream and listen to it."""
    with stream.conversation("speak_started", "word", "speak_ended", "error") as talk:
        yield talk, Told(talk)
