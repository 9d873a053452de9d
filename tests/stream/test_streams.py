from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from puppet import TinyAvatar, TinyNarrator, until

from app.config import Settings
from app.engine.pool import OrderedPool
from app.errors import Gone, NotFound, OverCapacity
from app.stream.live import LiveStream, StreamOptions
from app.stream.streams import Streams


def settings(**stream: Any) -> Settings:
    return Settings(stream={"preset": "ultrafast", "max_streams": 2, **stream})


@pytest.fixture
def pool() -> Iterator[OrderedPool]:
    pool = OrderedPool(2)
    yield pool
    pool.close()


def create(streams: Streams, **options: Any) -> LiveStream:
    return streams.create(TinyAvatar(), voice="buzz", options=StreamOptions(**options))  # type: ignore[arg-type]


async def test_streams_are_found_until_they_ended_too_long_ago(pool: OrderedPool) -> None:
    async with Streams(settings(keep_seconds=0.0), TinyNarrator(), pool) as streams:
        stream = create(streams)
        assert streams.get(stream.id) is stream
        await streams.end(stream.id)
        assert streams.get(stream.id).state == "ended"
        with pytest.raises(Gone):
            stream.watch("flv")
        await streams.reap()
        with pytest.raises(NotFound):
            streams.get(stream.id)
        with pytest.raises(NotFound):
            await streams.end("nobody")


async def test_there_is_a_limit_that_ended_streams_do_not_count_for(pool: OrderedPool) -> None:
    async with Streams(settings(), TinyNarrator(), pool) as streams:
        first, _second = create(streams), create(streams)
        with pytest.raises(OverCapacity):
            create(streams)
        await first.end()
        assert streams.running == 1
        create(streams)


async def test_an_idle_stream_ends_by_itself_and_its_file_stays_for_a_while(pool: OrderedPool) -> None:
    async with Streams(settings(idle_seconds=0.2, keep_seconds=1.5), TinyNarrator(), pool) as streams:
        busy = create(streams, start="now")
        viewer = busy.watch("flv")
        await anext(viewer)
        stream = create(streams, start="now")
        utterance = stream.say("0.3")
        await until(lambda: stream.state == "ended")
        assert utterance.state == "done"
        assert busy.state == "idle"
        path = stream.video(utterance.id)
        assert path.exists()
        await until(lambda: not path.exists())
        await until(lambda: stream.id not in streams._streams)
        assert streams.get(busy.id) is busy
        await viewer.aclose()  # type: ignore[attr-defined]
        await until(lambda: busy.state == "ended")


async def test_closing_leaves_nothing(pool: OrderedPool) -> None:
    threads, tasks = set(threading.enumerate()), asyncio.all_tasks()
    streams = Streams(settings(), TinyNarrator(), pool)
    folder: Path = streams._folder
    async with streams:
        for _ in range(2):
            stream = create(streams, start="now")
            stream.say("2 2 2")
        await until(lambda: stream.report().rendered > 3)
        assert len(streams.latency.utterances()) == 2
    await streams.close()
    await asyncio.sleep(0.02)
    assert not folder.exists()
    assert asyncio.all_tasks() <= tasks
    assert {each for each in threading.enumerate() if not each.name.startswith("asyncio_")} <= threads
    assert pool._lanes == []
