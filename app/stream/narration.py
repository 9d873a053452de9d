"""The thread that turns an utterance's text into pieces, a few ahead of what is shown."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

from app.stream.pieces import Piece

PIECES_AHEAD = 3
"""Pieces made and not yet taken; the thread sleeps when there are so many. A piece is a sentence or less."""


class Narration:
    """Runs an iterator of pieces in a thread of its own and hands over what it makes.

    Args:
        make: called in the thread; its iterator is closed in the thread, too. It gives None when it has nothing yet
            (it may wait for a moment first): then it is asked again, and is not taken for one that hangs.
        deliver: called in the thread with every piece, and at the end once with None, or with the error that ended it.
            After `cancel` only the end comes, when the engine has returned.
        name: of the thread, which does not keep the process from ending.

    Attributes:
        ended: nothing runs any more.
        thread: in which it runs.
    """

    def __init__(
        self,
        make: Callable[[], Iterator[Piece | None]],
        deliver: Callable[[Piece | BaseException | None], None],
        name: str,
    ) -> None:
        self.ended = False
        self._make = make
        self._deliver = deliver
        self._room = threading.Semaphore(PIECES_AHEAD)
        self._cancelled = threading.Event()
        self._working_since: float | None = None
        self.thread = threading.Thread(target=self._run, name=name, daemon=True)
        self.thread.start()

    @property
    def seconds_on_piece(self) -> float:
        """How long the piece in work has been in work; 0 if none is."""
        since = self._working_since
        return 0.0 if since is None else time.monotonic() - since

    def taken(self) -> None:
        """A piece is on its way to the viewers; there is room for another one."""
        self._room.release()

    def cancel(self) -> None:
        """Stop after the piece in work (a speech engine cannot be stopped inside a sentence). Returns at once."""
        self._cancelled.set()
        self._room.release()

    def _run(self) -> None:
        end: BaseException | None = None
        try:
            made = self._make()
            while self._room.acquire() and not self._cancelled.is_set():
                piece = self._next(made)
                if piece is None or self._cancelled.is_set():
                    break
                self._deliver(piece)
        except BaseException as error:
            end = error
        finally:
            self._working_since = None
        self.ended = True
        self._deliver(end)

    def _next(self, made: Iterator[Piece | None]) -> Piece | None:
        # The next piece, however long it takes to come; None at the end.
        while not self._cancelled.is_set():
            self._working_since = time.monotonic()
            try:
                piece = next(made)
            except StopIteration:
                return None
            finally:
                self._working_since = None
            if piece is not None:
                return piece
        return None
