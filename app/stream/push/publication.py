"""What the ways of publishing a stream have in common, inside the publishing process."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import BinaryIO, Protocol


class Publication(Protocol):
    """A stream on its way to a server; one call after the other, in this order."""

    def connect(self, request_keyframe: Callable[[], None]) -> None:
        """Open the connection; returns when the server lets the stream be published.

        Args:
            request_keyframe: may be called later, from any thread, when a key frame is needed.

        Raises:
            PublishingFailed: it did not come about.
        """

    def feed(self, source: BinaryIO) -> None:
        """Send the packets that are read from `source` (`app.stream.push.pipe`) until it ends.

        Raises:
            PublishingFailed: the connection broke.
        """

    def close(self) -> None:
        """Tell the server that the stream is over. After a failure, too; may raise anything then."""


@dataclass(frozen=True, slots=True)
class Failure:
    """Why publishing ended: `error` in our words, `detail` in the server's, whether it `refused` to be published to."""

    error: str
    refused: bool = False
    detail: str = ""


class PublishingFailed(Exception):
    """Carries a `Failure` to the end of the publishing process, which tells it as JSON.

    It never leaves that process, so it has no place in the tree of `app.errors`.
    """

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.error)
        self.failure = failure


def reason(error: BaseException) -> str:
    """What the operating system or FFmpeg says; not str(error), which names the URL."""
    return str(getattr(error, "strerror", "") or type(error).__name__)


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """End the process if this takes longer: SIGALRM does so by default, whatever the process waits in."""
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
