from __future__ import annotations

import asyncio
import gc
import threading
import weakref
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


async def test_of_an_ended_stream_only_its_record_is_kept(pool: OrderedPool) -> None:
    async with Streams(settings(), TinyNarrator(), pool) as streams:
        avatar = TinyAvatar()
        stream = streams.create(avatar, voice="buzz", options=StreamOptions(start="now", once=True))  # type: ignore[arg-type]
        utterance = stream.say("0.3")
        viewer = stream.watch("flv")
        production = stream._production
        assert production is not None
        kept = [
            weakref.ref(each)
            for each in (
                avatar,
                production,
                production._video,
                production._aac,
                production._opus,
                production._broadcast,
                production._film,
                production._lane,
                production.audience,
                production.program,
            )
        ]
        codec = weakref.ref(production._video._coder)
        del avatar, production
        assert len([chunk async for chunk in viewer]) > 3
        await until(lambda: stream.state == "ended" and stream.ended_at is not None)
        del viewer

        def let_go() -> bool:
            gc.collect()
            return all(each() is None for each in [*kept, codec])

        await until(let_go)
        report = stream.report()
        assert (report.id, report.state, report.avatar, report.voice) == (stream.id, "ended", "tiny", "buzz")
        assert report.viewers == {"whep": 0, "flv": 0, "mp4": 0, "rtmp": 0, "whip": 0}
        assert report.rendered > 10
        assert [each.state for each in report.utterances] == ["done"]
        assert stream.video(utterance.id).exists()
        stream.shown(utterance.id, 12.0)
        for refused in (lambda: stream.say("1"), stream.interrupt, lambda: stream.watch("flv"), lambda: stream.avatar):
            with pytest.raises(Gone):
                refused()
        with pytest.raises(NotFound):
            stream.peer("nobody")
        assert [event.data async for event in stream.events()] == [{"state": "ended"}]


async def test_ended_streams_are_bounded_and_the_oldest_goes_with_its_files(
    pool: OrderedPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.stream.streams.KEPT_ENDED", 3)
    async with Streams(settings(), TinyNarrator(), pool) as streams:
        ended = []
        for _ in range(5):
            ended.append(create(streams))
            await ended[-1].end(keep_files=True)
        running = create(streams)
        await streams.reap()
        for stream in ended[:2]:
            with pytest.raises(NotFound):
                streams.get(stream.id)
            assert not stream.folder.exists()
        assert [streams.get(stream.id) for stream in [*ended[2:], running]] == [*ended[2:], running]
        assert ended[2].folder.exists()


async def test_streams_whose_engine_hangs_hold_up_nobody(pool: OrderedPool) -> None:
    narrator = TinyNarrator()
    async with Streams(settings(idle_seconds=0.1), narrator, pool) as streams:
        try:
            hanging = [create(streams), create(streams)]
            for stream in hanging:
                stream.say("|")
                stream.interrupt()
            await until(lambda: all(stream.idle_since is not None for stream in hanging))
            await asyncio.sleep(0.15)
            await streams.reap()
            await until(lambda: all(stream.state == "ended" for stream in hanging))
            await asyncio.wait_for(streams.close(), 5)  # seconds; the engine has not returned
            assert not narrator.gate.is_set()
        finally:
            narrator.gate.set()


async def test_one_stream_that_ends_slowly_does_not_hold_up_the_reaper(
    pool: OrderedPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    let_go = asyncio.Event()
    async with Streams(settings(idle_seconds=0.05), TinyNarrator(), pool) as streams:
        slow, quick = create(streams), create(streams)
        assert slow._production is not None
        close = slow._production.close

        async def close_slowly() -> None:
            await let_go.wait()
            await close()

        monkeypatch.setattr(slow._production, "close", close_slowly)
        await until(lambda: quick.state == "ended")
        assert slow.state == "idle"
        let_go.set()
        await until(lambda: slow.state == "ended")


async def test_a_stream_that_cannot_end_properly_is_ended_all_the_same(
    pool: OrderedPool, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with Streams(settings(), TinyNarrator(), pool) as streams:
        stream = create(streams)
        assert stream._production is not None
        close = stream._production.close

        async def fail() -> None:
            await close()
            raise OSError("cannot")

        monkeypatch.setattr(stream._production, "close", fail)
        await streams.end(stream.id)
        assert stream.state == "ended"
        assert "did not end cleanly" in caplog.text
        assert streams.running == 0
