from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from puppet import FPS, SIZE, TinyAvatar, speech, until

from app.config import Settings
from app.engine.pool import OrderedPool
from app.errors import NotFound, OverCapacity
from app.stream.clock import StreamClock
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.events import EventBoard
from app.stream.pieces import pieces
from app.stream.program import KEPT_UTTERANCES, MAX_QUEUED, Program
from app.stream.timeline import Timeline
from app.stream.utterance import Utterance


@pytest.fixture
def pool() -> Iterator[OrderedPool]:
    pool = OrderedPool(1)
    yield pool
    pool.close()


class Bench:
    """A program on a clock that a test turns."""

    def __init__(self, folder: Path, pool: OrderedPool) -> None:
        self.told: list[tuple[str, dict[str, Any]]] = []
        events = EventBoard()
        events.post = lambda event: self.told.append((event.name, event.data))  # type: ignore[method-assign]
        self.program = Program(
            folder, VideoEncoder(SIZE, SIZE, FPS), AacEncoder(), Settings(), events, on_change=lambda: None
        )
        lane = pool.open(lambda _job: None, lambda _job, _picture: None, look_ahead=0.0)  # type: ignore[arg-type, return-value]
        clock = StreamClock(lambda: 1e9)
        self.timeline: Timeline[Utterance] = Timeline(TinyAvatar(), 50, clock, lane, encode_ahead=0.08, horizon=0.4)

    def say(self, *seconds: float) -> Utterance:
        utterance = Utterance(1)
        utterance.make = lambda: pieces(TinyAvatar(), (speech(("AA", each)) for each in seconds))
        self.program.add(utterance)
        return utterance

    def step(self, frame: float, *, may_start: bool = True) -> None:
        self.program.step(1e9 + frame / FPS, lambda _utterance: may_start, lambda: self.timeline)


@pytest.fixture
async def bench(tmp_path: Path, pool: OrderedPool) -> Any:
    bench = Bench(tmp_path, pool)
    yield bench
    await bench.program.close()
    assert list(tmp_path.iterdir()) == []


async def test_an_utterance_is_narrated_started_and_ended_on_the_clock(bench: Bench) -> None:
    utterance = bench.say(0.4)
    await until(lambda: utterance.narrated)
    bench.step(0, may_start=False)
    assert utterance.state == "queued"
    bench.step(0)
    assert (utterance.state, utterance.start, utterance.end) == ("speaking", 0, 15)
    bench.step(14)
    assert bench.program.current is utterance
    bench.step(15)
    assert bench.program.current is None
    assert utterance.state == "done"
    assert [(name, data["media_time"]) for name, data in bench.told] == [("speak_started", 0.0), ("speak_ended", 0.6)]
    assert bench.program.recording  # it still waits for its packets


async def test_only_what_is_needed_next_is_narrated(bench: Bench) -> None:
    first, second, third = bench.say(*[0.1] * 9), bench.say(0.1), bench.say(0.1)
    await until(lambda: len(first.ready) == 3)
    assert second.narration is None
    for frame in range(0, 40, 4):
        bench.step(frame)
        if first.narrated:
            break
        await until(lambda: first.ready or first.narrated)
    await until(lambda: second.narrated)
    await until(lambda: third.narrated)
    assert (second.state, third.state) == ("queued", "queued")


async def test_the_queue_is_bounded(bench: Bench) -> None:
    for _ in range(MAX_QUEUED):
        bench.program.check_room()
        bench.say(0.1)
    with pytest.raises(OverCapacity):
        bench.program.check_room()
    bench.program.interrupt(None, 1e9)
    bench.program.check_room()
    assert not bench.program.busy


async def test_the_oldest_utterances_are_forgotten(bench: Bench) -> None:
    made = []
    for _ in range(KEPT_UTTERANCES + 5):
        made.append(bench.say(0.1))
        bench.program.interrupt(None, 1e9)
    assert len(bench.program.utterances) == KEPT_UTTERANCES
    with pytest.raises(NotFound):
        bench.program.find(made[4].id)
    assert bench.program.find(made[5].id) is made[5]
