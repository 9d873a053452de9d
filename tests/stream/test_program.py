from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from puppet import FPS, PATIENCE, SIZE, TinyAvatar, speech, until

from app.config import Settings
from app.engine.pool import OrderedPool
from app.errors import OverCapacity
from app.speech import Speech
from app.stream.captions import Captions
from app.stream.clock import FRAME_SAMPLES, StreamClock
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.events import Event, EventBoard
from app.stream.pieces import pieces
from app.stream.program import MAX_QUEUED, Program
from app.stream.seats import Seats
from app.stream.timeline import Timeline
from app.stream.utterance import Utterance
from app.stream.utterances import Utterances

# A clock that a test turns is far from the one by which utterances are received.
SETTINGS = Settings(stream={"start_seconds": 1e12}, speech={"seconds": 0.2})


@pytest.fixture
def pool() -> Iterator[OrderedPool]:
    pool = OrderedPool(1)
    yield pool
    pool.close()


class Bench:
    """A program on a clock that a test turns."""

    def __init__(self, folder: Path, pool: OrderedPool, settings: Settings) -> None:
        self.told: list[tuple[str, dict[str, Any]]] = []
        events = EventBoard(Seats(1, "listeners"))
        events.post = self._post  # type: ignore[method-assign]
        self.cues: list[tuple[str, float]] = []
        self.said = Utterances()
        self.captions = Captions()
        lane = pool.open(lambda _job: None, lambda _job, _picture: None, look_ahead=0.0)  # type: ignore[arg-type, return-value]
        clock = StreamClock(lambda: 1e9)
        self.timeline: Timeline[Utterance] = Timeline(TinyAvatar(), 50, clock, lane, encode_ahead=0.08, horizon=0.4)
        self.program = Program(
            self.said,
            folder,
            VideoEncoder(SIZE, SIZE, FPS),
            AacEncoder(),
            settings,
            events,
            self.captions,
            make_timeline=lambda: self.timeline,
            on_change=lambda: None,
        )

    def _post(self, event: Event) -> None:
        if event.name in ("word", "viseme"):
            self.cues.append((event.name, event.data["media_time"]))
        else:
            self.told.append((event.name, event.data))

    def say(self, *seconds: float) -> Utterance:
        return self.speak(speech(("AA", each)) for each in seconds)

    def speak(self, speeches: Iterable[Speech | None]) -> Utterance:
        utterance = Utterance(1)
        utterance.make = lambda: pieces(TinyAvatar(), speeches)
        self.program.add(utterance)
        return utterance

    def ended(self) -> list[tuple[Any, ...]]:
        return [
            (data["utterance"], data["reason"], data["media_time"], data["wall_ms"] is None)
            for name, data in self.told
            if name == "speak_ended"
        ]

    def step(self, frame: float, *, watched: bool = True) -> np.ndarray:
        """What the production does at this time; returns the sound that left."""
        now = 1e9 + frame / FPS
        self.program.step(now, watched=watched)
        blocks = self.timeline.sound(now) if self.program.timeline is not None else ()
        return np.concatenate([np.zeros(0), *(block for _, block in blocks)])


@pytest.fixture
async def bench(tmp_path: Path, pool: OrderedPool) -> Any:
    bench = Bench(tmp_path, pool, SETTINGS)
    yield bench
    bench.program.stop()
    await bench.program.close()
    assert list(tmp_path.iterdir()) == []


async def test_an_utterance_is_narrated_started_and_ended_on_the_clock(bench: Bench) -> None:
    utterance = bench.say(0.4)
    await until(lambda: utterance.narrated)
    bench.step(0, watched=False)
    assert utterance.state == "queued"
    bench.step(0)
    assert (utterance.state, utterance.start, utterance.end) == ("speaking", 0, 15)
    for frame in range(1, 15):
        bench.step(frame)
        bench.step(frame + 0.5)
    assert bench.program.current is utterance
    bench.step(15)
    assert bench.program.current is None
    assert utterance.state == "done"
    assert [(name, data["media_time"]) for name, data in bench.told] == [("speak_started", 0.0), ("speak_ended", 0.6)]
    assert bench.program.recording  # it still waits for its packets


async def test_mouth_shapes_are_told_before_they_leave_until_speech_is_cut_short(bench: Bench) -> None:
    utterance = bench.speak(speech(*[("AA", 0.2), ("M", 0.2)] * 5) for _ in range(2))
    await until(lambda: len(utterance.ready) == 3)
    for step in range(40):  # 0.8 s
        frame = step / 2
        before = len(bench.cues)
        bench.step(frame)
        assert all(media_time > frame / FPS for _, media_time in bench.cues[max(before, 1) :])
    assert [media_time for _, media_time in bench.cues] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    bench.program.interrupt(1e9 + 20 / FPS)
    for frame in range(20, 60):
        bench.step(frame)
    assert len(bench.cues) == 6


async def test_a_text_that_is_not_written_yet_is_waited_for(bench: Bench) -> None:
    written = threading.Event()

    def speeches() -> Iterator[Speech | None]:
        yield speech(("AA", 0.2))
        while not written.wait(0.02):
            yield None
        yield speech(("AA", 0.2))

    utterance = bench.speak(speeches())
    await until(lambda: utterance.ready)
    for frame in range(int(3 * SETTINGS.speech.seconds * FPS)):
        bench.step(frame)
        await asyncio.sleep(1 / FPS)
    assert (utterance.state, utterance.error) == ("speaking", "")
    written.set()
    await until(lambda: utterance.narrated)
    bench.step(int(3 * SETTINGS.speech.seconds * FPS))
    assert utterance.end is not None


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
    bench.program.interrupt(1e9)
    bench.program.check_room()
    assert not bench.program.busy


async def test_after_a_pause_of_the_process_nothing_of_the_next_utterance_is_lost(bench: Bench) -> None:
    first, second = bench.say(0.4), bench.say(0.4)
    await until(lambda: second.narrated)
    for frame in range(6):
        bench.step(frame)
    heard = [bench.step(50.3), bench.step(50.8)]  # nothing ran in between
    assert first.state == "done"
    assert second.start is not None
    assert first.end is not None
    assert second.start >= first.end
    heard += [bench.step(frame) for frame in range(51, 80)]
    assert second.state == "done"
    assert [name for name, _ in bench.told] == ["speak_started", "speak_ended"] * 2
    loud = np.concatenate(heard) != 0
    assert loud.sum() > 14 * FRAME_SAMPLES  # the rest of the first and all of the second


async def test_a_piece_that_cannot_be_placed_is_not_lost(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    utterance = bench.say(0.4)
    await until(lambda: utterance.narrated)

    def fail(*_: object) -> int:
        raise ValueError("not now")

    with monkeypatch.context() as patch:
        patch.setattr(bench.timeline, "place", fail)
        with pytest.raises(ValueError, match="not now"):
            bench.step(0)
    bench.step(1)
    assert bench.told[0][0] == "speak_started"
    assert utterance.end is not None
    assert utterance.end - utterance.base == 15


async def test_every_utterance_ends_once_in_an_event(bench: Bench) -> None:
    def broken() -> Iterator[Speech]:
        raise RuntimeError("no engine")
        yield

    silent, failed, spoken, cut = bench.speak(()), bench.speak(broken()), bench.say(0.2), bench.say(1.0)
    await until(lambda: cut.narrated)
    for frame in range(25):
        bench.step(frame)
    waiting = bench.say(0.3)
    bench.program.interrupt(1e9 + 25 / FPS)
    bench.program.interrupt(1e9 + 25 / FPS)
    cut_end = cut.end
    for frame in range(25, 40):
        bench.step(frame)
    last, never = bench.say(1.0), bench.say(1.0)
    await until(lambda: last.narrated)
    for frame in range(40, 45):
        bench.step(frame)
    bench.program.stop()
    bench.program.stop()
    assert last.end is not None
    assert last.start is not None
    assert last.start < last.end < last.start + 10
    assert cut_end is not None
    assert spoken.end is not None
    assert bench.ended() == [
        (silent.id, "done", None, True),
        (failed.id, "failed", None, True),
        (spoken.id, "done", spoken.end / FPS, False),
        (waiting.id, "interrupted", None, True),
        (cut.id, "interrupted", cut_end / FPS, False),
        (last.id, "interrupted", last.end / FPS, False),
        (never.id, "interrupted", None, True),
    ]


def narrators() -> int:
    return sum(thread.name == "mary-narration" for thread in threading.enumerate())


async def test_interrupting_again_and_again_does_not_pile_up_threads(bench: Bench) -> None:
    let_go = threading.Event()
    begun: list[int] = []

    def slow(number: int) -> Iterator[Speech]:
        begun.append(number)
        assert let_go.wait(PATIENCE)
        yield speech(("AA", 0.2))

    most = 0
    for number in range(200):
        bench.program.interrupt(1e9)
        last = bench.speak(slow(number))
        bench.step(0)
        most = max(most, narrators())
    await until(lambda: begun)
    assert most == 1
    assert begun == [0]
    let_go.set()
    await until(lambda: last.narrated)
    assert begun == [0, 199]  # begun when the first had really ended
    await until(lambda: narrators() == 0)


async def test_an_engine_that_hangs_gets_one_more_chance_and_then_fails_at_once(bench: Bench) -> None:
    let_go = threading.Event()

    def hang() -> Iterator[Speech]:
        assert let_go.wait(PATIENCE)
        yield speech(("AA", 0.2))

    def step_until(condition: Callable[[], bool]) -> Callable[[], bool]:
        def stepped() -> bool:
            bench.step(0, watched=False)
            return condition()

        return stepped

    utterances = [bench.speak(hang()) for _ in range(5)]
    await until(step_until(lambda: all(each.state == "failed" for each in utterances)))
    assert narrators() == 2
    assert ["longer than 0.5 s" in each.error for each in utterances] == [True, True, False, False, False]
    assert "does not return" in utterances[2].error
    let_go.set()
    await until(lambda: narrators() == 0)
    good = bench.say(0.2)
    await until(step_until(lambda: good.narrated))
    assert not good.error


async def test_closing_does_not_wait_for_the_engine(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    let_go = threading.Event()

    def hang() -> Iterator[Speech]:
        assert let_go.wait(PATIENCE)
        yield speech(("AA", 0.2))

    bench.speak(hang())
    bench.program.stop()
    await bench.program.close()
    assert narrators() == 1
    assert all(thread.daemon for thread in threading.enumerate() if thread.name == "mary-narration")
    await until(lambda: "does not return" in caplog.text)
    let_go.set()
    await until(lambda: narrators() == 0)


async def test_a_file_that_cannot_be_written_is_not_waited_for(
    bench: Bench, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench.program, "_folder", tmp_path / "gone")
    utterance = bench.say(0.4)
    await until(lambda: utterance.narrated)
    bench.step(0)
    assert utterance.recording is not None
    assert utterance.recording.failed
    bench.program.finish_files(-1)
    assert not bench.program.recording
    assert "cannot be written" in caplog.text
