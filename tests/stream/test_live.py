from __future__ import annotations

import asyncio
import io
import threading
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from puppet import BACKGROUND, FPS, OPEN, PATIENCE, Seen, TinyAvatar, TinyNarrator, until, watch_file

from app.config import Settings
from app.engine.pool import OrderedPool
from app.errors import Gone, NotFound, NothingToSay, NotReady, OverCapacity
from app.stream.events import Event
from app.stream.live import LiveStream, StreamOptions
from app.stream.production import MAX_FAILURES
from app.stream.program import MAX_QUEUED
from app.stream.timeline import CLOSE_FRAMES, IdlePhase
from app.stream.timing import LatencyLog

SETTINGS = Settings(stream={"preset": "ultrafast", "crf": 12, "start_seconds": 0.3, "keyframe_seconds": 1.0})


@pytest.fixture
def pool() -> Iterator[OrderedPool]:
    pool = OrderedPool(2)
    yield pool
    pool.close()


@pytest.fixture(autouse=True)
def nothing_is_too_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine must not change what the tests see."""
    monkeypatch.setattr("app.stream.production.DROP_LATE", 60.0)


class Stage:
    """A stream with everything around it; checks at the end that nothing is left of it."""

    def __init__(self, pool: OrderedPool, folder: Path, **options: Any) -> None:
        self.narrator = TinyNarrator()
        self.avatar = TinyAvatar()
        self.latency = LatencyLog()
        self.folder = folder
        settings = options.pop("settings", SETTINGS)
        phase = options.pop("phase", None)
        self.stream = LiveStream(
            self.avatar,  # type: ignore[arg-type]
            voice="buzz",
            narrator=self.narrator,
            pool=pool,
            settings=settings,
            folder=self.folder,
            latency=self.latency,
            options=StreamOptions(**options),
            phase=phase,
        )
        self.events: list[Event] = []
        self._listener = asyncio.create_task(self._listen())
        self._viewers: list[asyncio.Task[None]] = []

    async def _listen(self) -> None:
        async for event in self.stream.events():
            self.events.append(event)

    def named(self, name: str) -> list[dict[str, Any]]:
        return [event.data for event in self.events if event.name == name]

    def view(self, format: str = "flv") -> bytearray:
        received = bytearray()
        chunks = self.stream.watch(format)  # type: ignore[arg-type]

        async def watch() -> None:
            try:
                async for chunk in chunks:
                    received.extend(chunk)
            finally:
                await chunks.aclose()  # type: ignore[attr-defined]

        self._viewers.append(asyncio.create_task(watch()))
        return received

    async def leave(self) -> None:
        for viewer in self._viewers:
            viewer.cancel()
        await asyncio.gather(*self._viewers, return_exceptions=True)
        self._viewers.clear()

    async def video(self, utterance: str | None = None) -> Seen:
        path: list[Path] = []

        def ready() -> bool:
            try:
                path[:] = [self.stream.video(utterance)]
            except NotReady:
                return False
            return True

        await until(ready)
        return watch_file(path[0])

    async def close(self) -> None:
        await self.stream.end()
        await asyncio.wait_for(asyncio.gather(self._listener, *self._viewers), PATIENCE)


@pytest.fixture
async def stage(pool: OrderedPool, tmp_path: Path) -> AsyncIterator[Any]:
    stages: list[Stage] = []
    threads, tasks = set(threading.enumerate()), asyncio.all_tasks()

    def make(**options: Any) -> Stage:
        stages.append(Stage(pool, options.pop("folder", tmp_path), **options))
        return stages[-1]

    yield make
    for each in stages:
        each.narrator.gate.set()
        await each.close()
    await asyncio.sleep(0.05)
    assert pool._lanes == []
    assert asyncio.all_tasks() <= tasks | {asyncio.current_task()}
    left = {thread for thread in threading.enumerate() if not thread.name.startswith("asyncio_")} - threads
    assert left == set()
    assert list(tmp_path.iterdir()) == []


def decode(received: bytearray, format: str = "flv") -> Seen:
    return watch_file(io.BytesIO(bytes(received)), format)


def check_lips(seen: Seen, tolerance: float = 1 / FPS) -> int:
    """Every time the mouth opens or closes the sound starts or stops; returns how often it opens."""
    opened = (seen.upper > (BACKGROUND + OPEN) / 2).astype(int)
    changes = np.flatnonzero(np.diff(opened)) + 1
    for change in changes:
        at = seen.times[change]
        before, after = seen.loud(at - tolerance - 0.03), seen.loud(at + tolerance - 0.01)
        assert (before > 0.1, after > 0.1) == (not opened[change], bool(opened[change])), at
    return int(np.sum(np.diff(opened) == 1)) + int(opened[0])


async def test_a_viewer_sees_and_hears_what_is_said_and_the_file_holds_it(stage: Any) -> None:
    live = stage()
    received = live.view()
    utterance = live.stream.say("0.31 0.17 0.44 0.23")
    await until(lambda: utterance.state == "done")
    file = await live.video()
    await live.stream.end(keep_files=True)
    assert live.stream.video(utterance.id).exists()
    assert check_lips(decode(received)) == 4
    assert check_lips(file) == 4
    assert abs(file.video_end - file.sound_end) < 0.04
    assert file.keyframes[0]
    np.testing.assert_allclose(np.diff(file.times), 1 / FPS, atol=2e-3)
    assert len(file.times) == utterance.end - utterance.start
    started, ended = live.named("speak_started")[0], live.named("speak_ended")[0]
    assert started["utterance"] == ended["utterance"] == utterance.id
    assert ended["reason"] == "done"
    assert started["media_time"] == utterance.start / FPS
    assert ended["media_time"] - started["media_time"] == pytest.approx(1.55 + 0.2, abs=0.05)
    assert ended["wall_ms"] - started["wall_ms"] == pytest.approx(
        1000 * (ended["media_time"] - started["media_time"]), abs=0.01
    )
    assert [event["state"] for event in live.named("state")][-3:] == ["speaking", "idle", "ended"]


async def test_all_stages_are_timed(stage: Any) -> None:
    live = stage()
    utterance = live.stream.say("0.2")
    live.view("mp4")
    await until(lambda: utterance.state == "done")
    live.stream.shown(utterance.id, 123.0)
    timings = live.stream.report().utterances[0].timings
    assert list(timings) == ["speech", "trajectory", "first_frame", "first_packet", "viewer", "shown"]
    assert timings["speech"] <= timings["trajectory"] <= timings["first_frame"] <= timings["first_packet"]
    (logged,) = live.latency.utterances()
    assert logged.timings.milliseconds()["shown"] == 123.0
    assert live.latency.utterances()[0].utterance == utterance.id
    with pytest.raises(NotFound):
        live.stream.shown("nobody", 1.0)


async def test_the_background_runs_on_through_speech_without_a_jump(stage: Any) -> None:
    live = stage()
    received = live.view()
    await until(lambda: live.stream.report().rendered > 10)
    utterance = live.stream.say("0.3")
    await until(lambda: utterance.state == "done")
    rendered = live.stream.report().rendered
    await until(lambda: live.stream.report().rendered > rendered + 10)
    await live.stream.end()
    seen = decode(received)
    loop = np.round((seen.lower - 30) / 4)
    frames = np.round(seen.times * FPS)
    assert np.all(np.abs((loop - frames - (loop[0] - frames[0]) + 25) % 50 - 25) <= 1)


async def test_the_background_starts_at_the_phase_of_the_pages_clip(stage: Any) -> None:
    live = stage(idle="local")
    live.view()
    await asyncio.sleep(0.1)
    at_ms = 1000 * time.time()
    utterance = live.stream.say("0.2", phase=IdlePhase(30.0, at_ms))
    await until(lambda: live.named("speak_started"))
    started = live.named("speak_started")[0]
    expected = 30 + (started["wall_ms"] - at_ms + 50) * FPS / 1000
    assert started["loop_frame"] == round(expected) % 50
    file = await live.video(utterance.id)
    assert file.lower[0] == pytest.approx(30 + 4 * started["loop_frame"], abs=3)


async def test_speech_waits_for_the_first_viewer(stage: Any) -> None:
    live = stage(
        settings=SETTINGS.model_copy(update={"stream": SETTINGS.stream.model_copy(update={"start_seconds": 60})})
    )
    utterance = live.stream.say("0.3 0.3")
    await until(lambda: len(live.narrator.spoken) == 2)
    await asyncio.sleep(0.1)
    assert live.stream.state == "waiting"
    assert utterance.start is None
    assert live.stream.report().rendered == 0
    received = live.view()
    await until(lambda: utterance.state == "done")
    await live.stream.end()
    assert check_lips(decode(received)) == 2  # the first word is there


async def test_without_a_viewer_speech_starts_after_a_while_or_at_once(stage: Any) -> None:
    waiting, eager = stage(), stage(start="now")
    utterances = [each.stream.say("0.2") for each in (waiting, eager)]
    await until(lambda: all(utterance.state == "done" for utterance in utterances))
    for each, utterance in zip((waiting, eager), utterances, strict=True):
        assert "viewer" not in utterance.timings.milliseconds()
        assert check_lips(await each.video()) == 1


async def test_utterances_follow_each_other(stage: Any) -> None:
    live = stage(start="now")
    first, second = live.stream.say("0.2 0.2"), live.stream.say("0.3")
    assert live.stream.state == "waiting"
    await until(lambda: second.state == "done")
    assert first.state == "done"
    assert first.end <= second.start <= first.end + 5
    assert check_lips(await live.video(first.id)) == 2
    assert check_lips(await live.video()) == 1
    assert [event["utterance"] for event in live.named("speak_ended")] == [first.id, second.id]


async def test_a_listener_who_comes_late_is_told_what_is_being_said(stage: Any) -> None:
    live = stage(start="now")
    live.stream.say("0.5")
    await until(lambda: live.named("speak_started"))
    late = live.stream.events()
    assert (await anext(late)).data == {"state": "speaking"}
    assert (await anext(late)).data == live.named("speak_started")[0]
    await late.aclose()
    await until(lambda: live.named("speak_ended"))
    later = live.stream.events()
    await anext(later)
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.05):
            await anext(later)


async def test_a_late_piece_delays_picture_and_sound_alike(stage: Any) -> None:
    live = stage(start="now")
    received = live.view()
    utterance = live.stream.say("0.3 | 0.3")
    await until(lambda: live.named("speak_started"))
    rendered = live.stream.report().rendered
    await until(lambda: live.stream.report().rendered > rendered + 25)
    assert utterance.state == "speaking"
    live.narrator.gate.set()
    await until(lambda: utterance.state == "done")
    file = await live.video()
    await live.stream.end()
    assert file.video_end > 1.4
    assert abs(file.video_end - file.sound_end) < 0.04
    np.testing.assert_allclose(np.diff(file.times), 1 / FPS, atol=2e-3)  # frames go on in the gap
    assert check_lips(file) == 2
    assert check_lips(decode(received)) == 2


async def test_interrupting_falls_silent_and_closes_the_mouth(stage: Any) -> None:
    live = stage(start="now")
    received = live.view()
    long = live.stream.say("5.0")
    queued = live.stream.say("1.0")
    await until(lambda: live.named("speak_started"))
    rendered = live.stream.report().rendered
    await until(lambda: live.stream.report().rendered > rendered + 12)
    live.stream.interrupt()
    assert (long.state, queued.state) == ("interrupted", "interrupted")
    await until(lambda: live.named("speak_ended"))
    ended = live.named("speak_ended")
    assert [(event["utterance"], event["reason"]) for event in ended] == [
        (queued.id, "interrupted"),
        (long.id, "interrupted"),
    ]
    assert (ended[0]["media_time"], ended[0]["wall_ms"]) == (None, None)
    assert ended[1]["media_time"] == long.end / FPS
    file = await live.video(long.id)
    after = live.stream.say("0.2")
    await until(lambda: after.state == "done")
    await live.stream.end()
    assert file.video_end < 2
    assert len(file.times) == long.end - long.start
    closing = file.upper[-CLOSE_FRAMES - 1 :]  # from open to closed, step by step
    assert closing[0] > OPEN - 12
    assert np.all(np.diff(closing) < -10)
    assert abs(closing[-1] - BACKGROUND) < 12
    silent_from = file.times[-CLOSE_FRAMES] + 2 / FPS
    assert file.loud(file.times[-CLOSE_FRAMES] - 2 / FPS) > 0.1
    assert file.loud(silent_from) < 0.02
    live_opened = decode(received).upper > (BACKGROUND + OPEN) / 2
    assert np.sum(np.diff(live_opened.astype(int), prepend=0) == 1) == 2
    with pytest.raises(NotFound):
        live.stream.video(queued.id)


async def test_saying_something_with_interrupt_replaces_everything(stage: Any) -> None:
    live = stage(start="now")
    utterances = [live.stream.say("5.0"), live.stream.say("5.0")]
    await until(lambda: live.named("speak_started"))
    last = live.stream.say("0.2", interrupt=True)
    await until(lambda: last.state == "done")
    assert [utterance.state for utterance in utterances] == ["interrupted", "interrupted"]
    assert check_lips(await live.video()) == 1


async def test_a_late_joiner_sees_a_whole_picture_at_once(stage: Any) -> None:
    live = stage(start="now")
    early = live.view()
    utterance = live.stream.say("2.0")
    await until(lambda: live.stream.report().rendered > 35)
    late, other = live.view("flv"), live.view("mp4")
    await until(lambda: utterance.state == "done")
    assert live.stream.report().viewers == {"whep": 0, "flv": 2, "mp4": 1, "rtmp": 0, "whip": 0}
    await live.stream.end()
    first, second, third = decode(early), decode(late), decode(other, "mp4")
    for joined in (second, third):
        assert joined.keyframes[0]
        assert joined.upper[0] > 150  # it joined in the middle of a word
        assert joined.times[-1] == pytest.approx(first.times[-1], abs=0.09)
        assert check_lips(joined) == 1
    assert len(second.times) < len(first.times)


async def test_nobody_watching_and_nothing_to_say_is_no_work(stage: Any) -> None:
    live = stage()
    assert live.stream.idle_since is not None
    live.view()
    await until(lambda: live.stream.report().rendered > 5)
    assert live.stream.idle_since is None
    await live.leave()
    await until(lambda: live.stream.idle_since is not None)
    await asyncio.sleep(0.1)
    rendered = live.stream.report().rendered
    sent = live.stream._production.program.timeline.sent
    await asyncio.sleep(0.3)
    assert live.stream.report().rendered == rendered
    assert live.stream._production.program.timeline.sent == sent
    again = live.view()  # and it wakes up again, with a new picture
    await until(lambda: live.stream.report().rendered > rendered + 5)
    await live.stream.end()
    seen = decode(again)
    assert seen.keyframes[0]
    assert seen.times[0] * FPS > rendered + 5


async def test_local_idling_sends_no_video(stage: Any) -> None:
    live = stage(idle="local")
    received = live.view()
    await asyncio.sleep(0.3)
    assert live.stream.report().rendered == 0
    utterance = live.stream.say("0.2")
    await until(lambda: utterance.state == "done")
    rendered = live.stream.report().rendered
    assert rendered == utterance.end - utterance.start
    await asyncio.sleep(0.2)
    assert live.stream.report().rendered == rendered
    await live.stream.end()
    assert decode(received).keyframes[0]


async def test_once_ends_by_itself_and_keeps_its_file(stage: Any) -> None:
    live = stage(once=True)
    received = live.view()
    live.stream.say("0.3")
    await until(lambda: live.stream.state == "ended")
    await asyncio.wait_for(asyncio.gather(*live._viewers), PATIENCE)  # the player sees the end of the file
    seen = decode(received)
    assert check_lips(seen) == 1
    assert seen.upper[-1] < 60
    picture_end = seen.times[-1] + 1 / FPS
    assert abs(picture_end - (seen.sound_start + len(seen.sound) / 48_000)) <= 0.04
    assert live.stream.video().exists()
    for refused in (lambda: live.stream.say("1"), live.stream.interrupt, lambda: live.stream.watch("flv")):
        with pytest.raises(Gone):
            refused()
    with pytest.raises(Gone):
        await live.stream.whep("")
    assert live.stream.expire(1000.0)
    assert not live.stream.expire(0.0)
    with pytest.raises(NotFound):
        live.stream.video()


async def test_a_failing_engine_costs_the_utterance_not_the_stream(stage: Any) -> None:
    live = stage(start="now")
    whole, half = live.stream.say("!"), live.stream.say("0.3 !")
    good = live.stream.say("0.2")
    await until(lambda: good.state == "done" and len(live.named("speak_ended")) == 3)
    assert (whole.state, half.state) == ("failed", "failed")
    assert [event["utterance"] for event in live.named("error")] == [whole.id, half.id]
    assert "the engine broke" in live.named("error")[0]["message"]
    assert [(event["utterance"], event["reason"]) for event in live.named("speak_ended")] == [
        (whole.id, "failed"),
        (half.id, "failed"),
        (good.id, "done"),
    ]
    assert check_lips(await live.video(half.id)) == 1
    with pytest.raises(NotFound):
        live.stream.video(whole.id)


async def test_an_engine_that_takes_too_long_fails(stage: Any) -> None:
    live = stage(
        start="now",
        settings=SETTINGS.model_copy(update={"speech": SETTINGS.speech.model_copy(update={"seconds": 0.2})}),
    )
    stuck, next_one = live.stream.say("|"), live.stream.say("0.2")
    await until(lambda: stuck.state == "failed" and live.named("error"))
    assert "took longer than 0.5 s" in live.named("error")[0]["message"]
    await until(lambda: next_one.state == "done")


async def test_a_renderer_that_fails_now_and_then_does_not_stop_the_stream(
    stage: Any, caplog: pytest.LogCaptureFixture
) -> None:
    live = stage(start="now")
    render = live.avatar.render

    def sometimes(coefficients: Any, loop_frame: int, out: Any) -> None:
        if loop_frame % 7 == 3:
            raise ValueError("no such picture")
        render(coefficients, loop_frame, out)

    live.avatar.render = sometimes
    utterance = live.stream.say("0.6")
    await until(lambda: utterance.state == "done")
    assert check_lips(await live.video()) == 1
    assert live.stream.report().dropped > 0
    assert "a frame cannot be made" in caplog.text


async def test_bad_requests_are_refused(stage: Any) -> None:
    live = stage()
    with pytest.raises(NothingToSay):
        live.stream.say("  ")
    with pytest.raises(NotFound):
        live.stream.video()
    with pytest.raises(NotFound):
        live.stream.video("nobody")
    with pytest.raises(NotFound):
        live.stream.peer("nobody")
    assert live.stream.say("1").unread == ()
    with pytest.raises(NotReady):
        live.stream.video()
    for _ in range(MAX_QUEUED - 1):
        live.stream.say("1")
    with pytest.raises(OverCapacity):
        live.stream.say("1")


async def test_ending_in_the_middle_of_everything_leaves_nothing(stage: Any, tmp_path: Path) -> None:
    live = stage(start="now")
    live.view("flv"), live.view("mp4")
    utterance = live.stream.say("3 3 3 3 3 3 3 3")
    live.stream.say("3")
    await until(lambda: live.stream.report().rendered > 5)
    await asyncio.gather(live.stream.end(), live.stream.end())
    assert utterance.state == "interrupted"
    assert live.stream.state == "ended"
    assert list(tmp_path.iterdir()) == []


async def test_a_viewer_who_does_not_read_slows_nobody(stage: Any) -> None:
    live = stage(start="now")
    stuck = live.stream.watch("flv")
    await anext(stuck)  # the header, and then it never reads again
    received = live.view()
    utterance = live.stream.say("0.5")
    await until(lambda: utterance.state == "done")
    await live.stream.end()
    assert check_lips(decode(received)) == 1
    assert live.stream.report().dropped == 0
    await stuck.aclose()  # type: ignore[attr-defined]


async def test_a_file_that_cannot_be_written_does_not_keep_the_stream_alive(
    stage: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    live = stage(once=True, folder=folder)
    received = live.view()
    folder.rmdir()
    utterance = live.stream.say("0.3")
    await until(lambda: live.stream.state == "ended")
    await asyncio.wait_for(asyncio.gather(*live._viewers), PATIENCE)  # they see the end of the file
    assert utterance.state == "done"
    assert check_lips(decode(received)) == 1
    assert "cannot be written" in caplog.text
    with pytest.raises(NotFound):
        live.stream.video()


async def test_a_stream_that_fails_again_and_again_ends(
    stage: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    live = stage(start="now")
    live.view()
    await until(lambda: live.stream.report().rendered > 3)

    def fail(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("no clock")

    monkeypatch.setattr(live.stream._production.program, "step", fail)
    utterance = live.stream.say("0.3")
    await until(lambda: live.stream.state == "ended")
    assert utterance.state == "interrupted"
    await asyncio.wait_for(asyncio.gather(live._listener, *live._viewers), PATIENCE)
    assert caplog.text.count("Traceback") == 1
    assert f"{MAX_FAILURES} failed steps in a row" in caplog.text
    assert "no clock" in live.named("error")[0]["message"]
    assert [event.name for event in live.events][-3:] == ["error", "speak_ended", "state"]
    assert live.named("state")[-1] == {"state": "ended"}


async def test_viewers_and_listeners_of_a_stream_are_limited(stage: Any) -> None:
    live = stage(settings=SETTINGS.model_copy(update={"stream": SETTINGS.stream.model_copy(update={"max_viewers": 3})}))
    await asyncio.sleep(0)  # the stage's own listener has taken a seat
    early = live.stream.watch("mp4")
    live.view("flv")
    live.view("mp4")
    await until(lambda: live.stream.report().viewers == {"whep": 0, "flv": 1, "mp4": 1, "rtmp": 0, "whip": 0})
    for refused in (lambda: live.stream.watch("flv"), lambda: live.stream.watch("mp4"), live.stream.events):
        with pytest.raises(OverCapacity, match="3 viewers of this stream"):
            refused()
    with pytest.raises(OverCapacity):
        await live.stream.whep("v=0")
    with pytest.raises(OverCapacity):
        await anext(early)
    await live.leave()
    live.view()
    await until(lambda: live.stream.report().viewers["flv"] == 1)


async def test_what_ends_with_the_stream_is_told_before_its_end(stage: Any) -> None:
    live = stage(start="now")
    spoken, queued = live.stream.say("3"), live.stream.say("3")
    await until(lambda: live.named("speak_started"))
    await live.stream.end()
    await live._listener
    ended = live.named("speak_ended")
    assert [(event["utterance"], event["reason"]) for event in ended] == [
        (spoken.id, "interrupted"),
        (queued.id, "interrupted"),
    ]
    assert ended[0]["media_time"] is not None
    assert ended[1]["media_time"] is None
    assert live.events[-1] == Event("state", {"state": "ended"})
