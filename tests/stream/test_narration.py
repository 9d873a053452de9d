from __future__ import annotations

import queue
import threading
from collections.abc import Iterator

import numpy as np

from app.stream.narration import PIECES_AHEAD, Narration
from app.stream.pieces import Piece

PATIENCE = 20.0


def piece(n: int) -> Piece:
    return Piece(n, np.zeros(1, np.float32), n, np.zeros((1, 2), np.float32))


def test_pieces_come_in_order_and_then_the_end() -> None:
    got: queue.Queue[object] = queue.Queue()
    narration = Narration(lambda: (piece(n) for n in range(10)), got.put, "test")
    for n in range(10):
        item = got.get(timeout=PATIENCE)
        assert isinstance(item, Piece)
        assert item.frame == n
        narration.taken()
    assert got.get(timeout=PATIENCE) is None
    assert narration.ended


def test_it_stays_only_a_few_pieces_ahead() -> None:
    made: list[int] = []
    got: queue.Queue[object] = queue.Queue()
    blocked = threading.Event()

    def make() -> Iterator[Piece]:
        for n in range(100):
            made.append(n)
            if n == PIECES_AHEAD - 1:
                blocked.set()
            yield piece(n)

    narration = Narration(make, got.put, "test")
    assert blocked.wait(PATIENCE)
    for _ in range(PIECES_AHEAD):
        got.get(timeout=PATIENCE)
    narration.thread.join(0.05)
    assert len(made) == PIECES_AHEAD
    assert narration.seconds_on_piece == 0
    narration.taken()
    got.get(timeout=PATIENCE)
    assert len(made) == PIECES_AHEAD + 1
    narration.cancel()
    assert got.get(timeout=PATIENCE) is None  # nothing but the end
    assert narration.ended
    assert got.empty()


def test_it_asks_again_where_there_is_nothing_yet_and_is_not_taken_for_hanging() -> None:
    got: queue.Queue[object] = queue.Queue()
    asked = threading.Semaphore(0)
    there = threading.Event()

    def make() -> Iterator[Piece | None]:
        while not there.is_set():
            there.wait(0.01)
            asked.release()
            yield None
        yield piece(7)

    narration = Narration(make, got.put, "test")
    for _ in range(20):
        assert asked.acquire(timeout=PATIENCE)
    assert narration.seconds_on_piece < 0.2  # though 20 times 0.01 s have passed
    assert got.empty()
    there.set()
    assert getattr(got.get(timeout=PATIENCE), "frame", None) == 7
    assert got.get(timeout=PATIENCE) is None


def test_while_there_is_nothing_it_can_be_cancelled() -> None:
    got: queue.Queue[object] = queue.Queue()

    def make() -> Iterator[Piece | None]:
        while True:
            yield None

    narration = Narration(make, got.put, "test")
    narration.cancel()
    assert got.get(timeout=PATIENCE) is None
    narration.thread.join(PATIENCE)
    assert narration.ended


def test_an_error_is_handed_over_as_the_end() -> None:
    got: queue.Queue[object] = queue.Queue()

    def make() -> Iterator[Piece]:
        yield piece(0)
        raise OSError("no model")

    narration = Narration(make, got.put, "test")
    assert isinstance(got.get(timeout=PATIENCE), Piece)
    assert isinstance(got.get(timeout=PATIENCE), OSError)
    assert narration.ended


def test_cancelling_inside_a_piece_delivers_nothing_but_the_end() -> None:
    got: queue.Queue[object] = queue.Queue()
    inside, let_go, closed = threading.Event(), threading.Event(), threading.Event()

    def make() -> Iterator[Piece]:
        try:
            inside.set()
            assert let_go.wait(PATIENCE)
            yield piece(0)
        finally:
            closed.set()

    narration = Narration(make, got.put, "test")
    assert inside.wait(PATIENCE)
    assert narration.seconds_on_piece > 0
    narration.cancel()
    let_go.set()
    assert closed.wait(PATIENCE)
    assert got.get(timeout=PATIENCE) is None
    assert got.empty()
