from __future__ import annotations

import asyncio

import pytest

from app.errors import OverCapacity
from app.stream.events import QUEUED_EVENTS, Event, EventBoard
from app.stream.seats import Seats


def first() -> list[Event]:
    return [Event("state", {"state": "idle"})]


async def collect(board: EventBoard) -> list[Event]:
    return [event async for event in board.listen(first)]


async def test_every_listener_hears_everything_from_when_it_began_to_the_end() -> None:
    board = EventBoard(Seats(2, "listeners"))
    board.post(Event("error"))
    listeners = [asyncio.create_task(collect(board)) for _ in range(2)]
    await asyncio.sleep(0)
    board.post(Event("error", {"message": "x"}))
    board.close()
    for listener in listeners:
        assert await listener == [*first(), Event("error", {"message": "x"})]
    assert await collect(board) == first()
    assert not board._listeners


async def test_a_listener_that_does_not_read_loses_the_oldest() -> None:
    board = EventBoard(Seats(2, "listeners"))
    listener = board.listen(first)
    assert [await anext(listener)] == first()
    for n in range(QUEUED_EVENTS + 10):
        board.post(Event("word", {"n": n}))
    board.close()
    heard = [event.data["n"] async for event in listener]
    assert heard == list(range(11, QUEUED_EVENTS + 10))


async def test_a_listener_hears_only_what_it_asked_for() -> None:
    board = EventBoard(Seats(2, "listeners"))
    listener = board.listen(lambda: [Event("state"), Event("speak_started")], {"speak_started", "word"})
    heard = [await anext(listener)]
    for name in ("viseme", "word", "error", "word"):
        board.post(Event(name))  # type: ignore[arg-type]
    board.close()
    heard += [event async for event in listener]
    assert [event.name for event in heard] == ["speak_started", "word", "word"]


async def test_listeners_are_limited() -> None:
    board = EventBoard(Seats(1, "listeners"))
    listener, early = board.listen(first), board.listen(first)
    await anext(listener)
    with pytest.raises(OverCapacity):
        board.listen(first)
    with pytest.raises(OverCapacity):
        await anext(early)
    await listener.aclose()  # type: ignore[attr-defined]
    assert await anext(board.listen(first)) == first()[0]
