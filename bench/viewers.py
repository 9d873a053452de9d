"""Viewers over HTTP: each in a thread of its own, with the arrival of everything, and a file of it to look at later."""

from __future__ import annotations

import threading
import time
import urllib.request
from pathlib import Path
from typing import Self

from bench.flv_reader import FlvReader, Tag

ROUNDED = 0.0006
"""Seconds: FLV counts milliseconds."""


class HttpViewer:
    """Watches an address to its end and keeps what comes in a file. A context manager.

    Attributes:
        path: where the file is.
        arrivals: Unix time and bytes of what came.
    """

    def __init__(self, url: str, path: Path) -> None:
        self.path = path
        self.arrivals: list[tuple[float, int]] = []
        self._answer = urllib.request.urlopen(url, timeout=30)
        self._thread = threading.Thread(target=self._receive, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.join()

    def join(self) -> None:
        """Wait until the stream has ended."""
        self._thread.join(30)

    def take(self, data: bytes, arrived: float) -> None:
        """Something came."""
        self.arrivals.append((arrived, len(data)))

    def _receive(self) -> None:
        with self._answer, self.path.open("wb") as file:
            while data := self._answer.read1(1 << 16):
                self.take(data, time.time())
                file.write(data)


class FlvViewer(HttpViewer):
    """Watches `live.flv`.

    Attributes:
        tags: what came so far, in order of arrival.
    """

    def __init__(self, url: str, path: Path) -> None:
        super().__init__(url, path)
        self.tags: list[Tag] = []
        self._reader = FlvReader()

    def take(self, data: bytes, arrived: float) -> None:
        """Read it."""
        super().take(data, arrived)
        self.tags.extend(self._reader.feed(data, arrived))

    def first(self, kind: int, seconds: float, wait: float = 10.0) -> Tag:
        """The first tag of a kind at or after a moment of the stream, waited for if need be.

        Raises:
            TimeoutError: it did not come.
        """
        give_up = time.monotonic() + wait
        place = 0
        while True:
            for tag in self.tags[place:]:
                if tag.kind == kind and tag.seconds >= seconds - ROUNDED:
                    return tag
                place += 1
            if time.monotonic() > give_up:
                raise TimeoutError(f"no tag of kind {kind} at or after {seconds} s came within {wait} s")
            time.sleep(0.01)

    def carrier(self, kind: int, seconds: float) -> Tag | None:
        """The tag that holds a moment: the last one that begins at or before it; None if a later one has not come."""
        found = None
        for tag in self.tags:
            if tag.kind == kind:
                if tag.seconds > seconds + ROUNDED:
                    return found
                found = tag
        return None
