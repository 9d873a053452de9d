from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.stream.broadcast import MAX_CUTS, MAX_ITEMS, Broadcast, Subscription


@dataclass(frozen=True)
class Thing:
    seconds: float
    starts: bool = False
    kind: str = "video"


def pictures(count: int, every: int = 10, first: int = 0) -> Iterator[Thing]:
    for number in range(first, first + count):
        yield Thing(number / 10, starts=number % every == 0)


async def rest(subscription: Subscription[Thing]) -> list[float]:
    """Everything until the end."""
    return [item.seconds async for item in subscription]


async def test_everyone_gets_everything_in_order() -> None:
    broadcast: Broadcast[Thing] = Broadcast()
    one, two = broadcast.subscribe(), broadcast.subscribe()
    things = list(pictures(30))
    for thing in things:
        broadcast.publish(thing)
    assert broadcast.subscribers == 2
    broadcast.close()
    assert await rest(one) == await rest(two) == [thing.seconds for thing in things]
    assert broadcast.subscribers == 0


async def test_a_late_viewer_starts_with_the_group_of_pictures() -> None:
    broadcast: Broadcast[Thing] = Broadcast()
    for thing in pictures(25):
        broadcast.publish(thing)
    late = broadcast.subscribe()
    broadcast.publish(Thing(2.5))
    broadcast.close()
    assert await rest(late) == [2.0, 2.1, 2.2, 2.3, 2.4, 2.5]


async def test_without_backlog_a_viewer_starts_with_the_next_key_frame() -> None:
    broadcast: Broadcast[Thing] = Broadcast()
    for thing in pictures(25):
        broadcast.publish(thing)
    late = broadcast.subscribe(backlog=False)
    for thing in pictures(10, first=25):
        broadcast.publish(thing)
    broadcast.close()
    assert await rest(late) == [3.0, 3.1, 3.2, 3.3, 3.4]


async def test_nothing_comes_before_a_key_frame_not_even_sound() -> None:
    broadcast: Broadcast[Thing] = Broadcast()
    both = broadcast.subscribe({"video", "aac"})
    for thing in (Thing(0.0, kind="aac"), Thing(0.1), Thing(0.2, starts=True), Thing(0.3, kind="aac")):
        broadcast.publish(thing)
    broadcast.close()
    assert await rest(both) == [0.2, 0.3]


async def test_sound_alone_starts_at_once_and_pictures_alone_are_alone() -> None:
    broadcast: Broadcast[Thing] = Broadcast()
    broadcast.publish(Thing(0.0, starts=True))
    sound, sight = broadcast.subscribe({"opus"}), broadcast.subscribe({"video"})
    broadcast.publish(Thing(0.1, kind="opus"))
    broadcast.publish(Thing(0.2, kind="aac"))
    broadcast.publish(Thing(0.3))
    broadcast.close()
    assert await rest(sound) == [0.1]
    assert await rest(sight) == [0.0, 0.3]


async def test_headers_come_first_for_everyone() -> None:
    broadcast: Broadcast[Thing] = Broadcast()
    early = broadcast.subscribe()
    broadcast.publish(Thing(0.0, kind="header"))
    broadcast.publish(Thing(0.0))
    assert (await anext(early)).kind == "header"
    for thing in pictures(1000):
        broadcast.publish(thing)
    late = broadcast.subscribe()
    broadcast.publish(Thing(100.0, starts=True))
    broadcast.close()
    assert (await anext(late)).kind == "header"
    assert await rest(late) == [99.0 + n / 10 for n in range(10)] + [100.0]
    assert late.cuts == 0


async def test_a_long_time_without_pictures_is_no_place_to_start() -> None:
    broadcast: Broadcast[Thing] = Broadcast(cache_seconds=5.0)
    broadcast.publish(Thing(0.0, starts=True))
    for number in range(1, 60):
        broadcast.publish(Thing(number / 10, kind="aac"))
    late = broadcast.subscribe()
    broadcast.publish(Thing(6.0, kind="aac"))
    broadcast.publish(Thing(6.1, starts=True))
    broadcast.close()
    assert await rest(late) == [6.1]


async def test_a_slow_viewer_is_cut_to_a_key_frame_and_the_others_are_not() -> None:
    broadcast: Broadcast[Thing] = Broadcast(queue_seconds=2.0)
    slow, quick = broadcast.subscribe(), broadcast.subscribe()
    seen = []
    for thing in pictures(25):
        broadcast.publish(thing)
        seen.append((await anext(quick)).seconds)
    assert seen == [thing.seconds for thing in pictures(25)]
    assert (slow.cuts, quick.cuts) == (1, 0)
    broadcast.close()
    assert (await anext(slow)) == Thing(2.0, starts=True)
    assert not slow.slow


async def test_a_queue_without_key_frame_is_emptied_until_one_comes() -> None:
    broadcast: Broadcast[Thing] = Broadcast(queue_seconds=2.0)
    slow = broadcast.subscribe()
    for thing in pictures(60, every=50):
        broadcast.publish(thing)
    broadcast.close()
    assert await rest(slow) == [5.0, 5.1, 5.2, 5.3, 5.4, 5.5, 5.6, 5.7, 5.8, 5.9]


async def test_who_is_too_slow_again_and_again_is_disconnected() -> None:
    broadcast: Broadcast[Thing] = Broadcast(queue_seconds=2.0)
    slow = broadcast.subscribe()
    waiting = asyncio.create_task(rest(broadcast.subscribe()))
    for thing in pictures(100):
        broadcast.publish(thing)
        await asyncio.sleep(0)
    assert slow.slow
    assert slow.cuts == MAX_CUTS
    assert await rest(slow) == []
    assert broadcast.subscribers == 1
    broadcast.close()
    assert len(await waiting) == 100


async def test_being_slow_now_and_then_is_forgiven() -> None:
    broadcast: Broadcast[Thing] = Broadcast(queue_seconds=2.0)
    viewer = broadcast.subscribe()
    for round_ in range(6):
        for thing in pictures(25, first=round_ * 1000):  # a hundred seconds apart
            broadcast.publish(thing)
        while viewer._queue:
            await anext(viewer)
    assert viewer.cuts >= 5
    assert not viewer.slow


@pytest.mark.parametrize("starts", [True, False])
async def test_queues_are_bounded_when_time_stands_still(starts: bool) -> None:
    broadcast: Broadcast[Thing] = Broadcast()
    viewer = broadcast.subscribe()
    broadcast.publish(Thing(0.0, starts=True))
    for _ in range(3 * MAX_ITEMS):
        broadcast.publish(Thing(0.0, starts=starts))
        assert len(viewer._queue) <= MAX_ITEMS
        assert len(broadcast._cache) <= MAX_ITEMS


async def test_a_viewer_that_joined_with_a_long_backlog_is_not_slow() -> None:
    broadcast: Broadcast[Thing] = Broadcast(queue_seconds=1.0)
    for thing in pictures(50, every=100):
        broadcast.publish(thing)
    late = broadcast.subscribe()
    broadcast.publish(Thing(5.0))
    assert late.cuts == 0


async def test_close_wakes_those_who_wait() -> None:
    broadcast: Broadcast[Thing] = Broadcast()
    tasks = [asyncio.create_task(rest(broadcast.subscribe())) for _ in range(3)]
    await asyncio.sleep(0.01)
    broadcast.close()
    broadcast.close()
    assert await asyncio.gather(*tasks) == [[], [], []]
    broadcast.publish(Thing(0.0, starts=True))
    assert await rest(broadcast.subscribe()) == []


async def test_leaving_ends_ones_own_iteration_only() -> None:
    broadcast: Broadcast[Thing] = Broadcast()
    with broadcast.subscribe() as one, broadcast.subscribe() as two:
        task = asyncio.create_task(rest(one))
        await asyncio.sleep(0.01)
        one.close()
        one.close()
        assert await task == []
        assert broadcast.subscribers == 1
        broadcast.publish(Thing(0.0, starts=True))
        assert (await anext(two)).seconds == 0.0
    assert broadcast.subscribers == 0


async def test_publishing_from_threads() -> None:
    broadcast: Broadcast[Thing] = Broadcast(queue_seconds=1000)
    subscriptions = [broadcast.subscribe({"video", name}) for name in "abcd"]
    broadcast.publish(Thing(0.0, starts=True))
    readers = [asyncio.create_task(rest(subscription)) for subscription in subscriptions]

    def publish(name: str) -> None:
        for number in range(500):
            broadcast.publish(Thing(float(number), kind=name))

    threads = [threading.Thread(target=publish, args=name) for name in "abcd"]
    for thread in threads:
        thread.start()
    await asyncio.to_thread(lambda: [thread.join() for thread in threads])
    await asyncio.to_thread(broadcast.close)
    for seen in await asyncio.gather(*readers):
        assert seen == [0.0, *map(float, range(500))]


def test_a_viewer_whose_event_loop_has_gone_is_forgotten() -> None:
    broadcast: Broadcast[Thing] = Broadcast()

    async def come_and_go() -> None:
        task = asyncio.create_task(rest(broadcast.subscribe()))
        await asyncio.sleep(0.01)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        broadcast._subscriptions[0]._waiter = asyncio.get_running_loop().create_future()

    asyncio.run(come_and_go())
    assert broadcast.subscribers == 1
    broadcast.publish(Thing(0.0, starts=True))
    assert broadcast.subscribers == 0


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 3)), max_size=80), st.integers(1, 30))
def test_whatever_happens_a_picture_follows_its_predecessor_or_starts(
    steps: list[tuple[bool, int]], queue: int
) -> None:
    """Reading in any rhythm, what comes is either next in line or a key frame, and the queue keeps its bound."""

    async def run() -> None:
        broadcast: Broadcast[Thing] = Broadcast(queue_seconds=queue / 10)
        viewer = broadcast.subscribe()
        last: int | None = None
        for number, (starts, reads) in enumerate(steps):
            broadcast.publish(Thing(number / 10, starts=starts))
            assert not viewer._queue or viewer._queue[-1].seconds - viewer._queue[0].seconds <= queue / 10 + 1e-9
            for _ in range(min(reads, len(viewer._queue))):
                item = await anext(viewer)
                place = round(item.seconds * 10)
                assert item.starts or place == (last if last is not None else -2) + 1
                last = place

    asyncio.run(run())
