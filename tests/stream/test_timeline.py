from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from puppet import TinyAvatar

from app.engine.pool import FrameJob
from app.stream.clock import BLOCK_SAMPLES, FPS, FRAME_SAMPLES, StreamClock
from app.stream.pieces import JOIN_FRAMES, Piece
from app.stream.timeline import CLOSE_FRAMES, EASE_FRAMES, IdlePhase, Timeline

ORIGIN = 1000.0


class LaneOfFrames:
    """The part of `Lane` a timeline uses; a test says what has been encoded."""

    def __init__(self) -> None:
        self.jobs: list[FrameJob] = []
        self.encoded = -1

    def submit(self, jobs: Iterable[FrameJob]) -> None:
        for job in jobs:
            assert not self.jobs or job.index > self.jobs[-1].index
            assert job.index > self.encoded
            self.jobs.append(job)

    def discard(self, first: int) -> int:
        keep = [job for job in self.jobs if job.index < first or job.index <= self.encoded]
        count, self.jobs = len(self.jobs) - len(keep), keep
        return count

    @property
    def indices(self) -> list[int]:
        return [job.index for job in self.jobs]

    def openings(self) -> list[float | None]:
        return [None if job.payload.coefficients is None else float(job.payload.coefficients[0]) for job in self.jobs]


class Bench:
    def __init__(self) -> None:
        self.lane = LaneOfFrames()
        self.clock = StreamClock(lambda: ORIGIN, lambda: 5e8)
        self.timeline: Timeline[str] = Timeline(
            TinyAvatar(),
            50,
            self.clock,
            self.lane,
            encode_ahead=0.08,
            horizon=0.401,  # type: ignore[arg-type]
        )

    def at(self, frame: float) -> float:
        """The clock when this frame is released; the frames before are encoded, the sound has left."""
        now = ORIGIN + frame / FPS
        self.lane.encoded = int(frame) - 1
        return now

    def sound(self, now: float) -> np.ndarray:
        blocks = list(self.timeline.sound(now))
        return np.concatenate([block for _, block in blocks]) if blocks else np.zeros(0)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def closing(share: float) -> float:
    """How open a mouth is that stood still and closes, after this share of the time."""
    return (1 - share) ** 2 * (1 + 2 * share)


def piece(first: int, frames: int, *, samples: tuple[int, int] | None = None) -> Piece:
    start, end = samples or (first * FRAME_SAMPLES, (first + frames) * FRAME_SAMPLES)
    return Piece(start, np.ones(end - start, np.float32), first, np.ones((frames, 2), np.float32))


def test_idle_frames_are_handed_over_as_far_as_the_horizon(bench: Bench) -> None:
    bench.timeline.fill(bench.at(0), None)
    assert bench.lane.indices == list(range(11))
    bench.timeline.fill(bench.at(0.5), None)
    assert bench.lane.indices == list(range(11))
    bench.timeline.fill(bench.at(1), None)
    assert bench.lane.indices == list(range(12))
    assert bench.lane.jobs[3].deadline == pytest.approx(ORIGIN + 3 / FPS + 0.08)
    looks = [job.payload for job in bench.lane.jobs]
    assert [look.keyframe for look in looks] == [True] + [False] * 11
    assert [look.loop_frame for look in looks] == list(range(12))
    assert all(look.coefficients is None and look.owner is None for look in looks)


def test_speech_takes_the_place_of_idle_frames_not_yet_encoded(bench: Bench) -> None:
    bench.timeline.fill(bench.at(0), None)
    bench.sound(bench.at(2.5))
    bench.lane.encoded = 3  # one is encoded ahead of the sound
    base = bench.timeline.begin(ORIGIN + 2.5 / FPS)
    assert base == 4
    assert bench.timeline.place(piece(0, 5), base, "u", ORIGIN + 2.5 / FPS) == 0
    assert bench.lane.indices == list(range(9))
    assert bench.lane.openings() == [None] * 4 + [1.0] * 5
    assert bench.lane.jobs[4].payload.keyframe
    assert [job.payload.owner for job in bench.lane.jobs] == [None] * 4 + ["u"] * 5
    heard = bench.sound(bench.at(20))
    first = np.flatnonzero(heard)[0] + 6 * BLOCK_SAMPLES
    assert first == base * FRAME_SAMPLES  # to the sample


def test_pieces_join_without_a_gap_at_any_sample(bench: Bench) -> None:
    now = bench.at(0)
    base = bench.timeline.begin(now)
    first = piece(0, 4, samples=(0, 3 * FRAME_SAMPLES + 700))
    second = piece(4, 3, samples=(3 * FRAME_SAMPLES + 700, 6 * FRAME_SAMPLES + 1))
    assert bench.timeline.place(first, base, "u", now) == 0
    assert bench.timeline.place(second, base, "u", now) == 0
    assert bench.lane.indices == list(range(base, base + 7))
    heard = bench.sound(bench.at(9))
    assert heard.sum() == 6 * FRAME_SAMPLES + 1
    assert np.all(heard[base * FRAME_SAMPLES : base * FRAME_SAMPLES + 6 * FRAME_SAMPLES + 1] == 1)


def test_a_late_piece_is_delayed_by_whole_frames_with_its_sound(bench: Bench) -> None:
    now = bench.at(0)
    base = bench.timeline.begin(now)
    bench.timeline.place(piece(0, 4, samples=(0, 4 * FRAME_SAMPLES - 700)), base, "u", now)
    for frame in range(10):
        now = bench.at(frame)
        bench.timeline.fill(now, "u")
        bench.sound(now)
    assert bench.lane.openings()[:10] == [1.0] * 4 + [pytest.approx(closing(n / 6), abs=1e-6) for n in range(1, 7)]
    assert all(job.payload.owner == "u" for job in bench.lane.jobs)
    late = piece(4, 3, samples=(4 * FRAME_SAMPLES - 700, 7 * FRAME_SAMPLES))
    delay = bench.timeline.place(late, base, "u", now)
    assert delay == 6 - base  # frame 9 is being encoded, 10 is the first that can be chosen
    assert bench.lane.openings()[-3:] == [1.0] * 3
    assert bench.lane.indices == list(range(13))
    heard = bench.sound(bench.at(20))
    at = 10 * FRAME_SAMPLES - 700 - (9 * FRAME_SAMPLES + BLOCK_SAMPLES)
    assert np.flatnonzero(heard)[0] == max(0, at)


def test_a_late_piece_goes_on_from_the_mouth_that_is_shown(bench: Bench) -> None:
    now = bench.at(0)
    base = bench.timeline.begin(now)
    bench.timeline.place(piece(0, 4), base, "u", now)
    for frame in range(14):  # the mouth closes meanwhile
        now = bench.at(frame)
        bench.timeline.fill(now, "u")
        bench.sound(now)
    follows = np.ones(2, np.float32)
    bench.timeline.place(replace(piece(4, 8), follows=follows), base, "u", now)
    openings = bench.lane.openings()[-8:]
    opening = [pytest.approx(n / (JOIN_FRAMES + 1), abs=1e-6) for n in range(1, JOIN_FRAMES + 1)]
    assert openings == [*opening, 1.0, 1.0, 1.0]


def test_a_piece_in_time_is_shown_as_it_was_made(bench: Bench) -> None:
    now = bench.at(0)
    base = bench.timeline.begin(now)
    bench.timeline.place(replace(piece(0, 4), follows=np.array([0, 1], np.float32)), base, "u", now)
    bench.timeline.place(replace(piece(4, 4), follows=np.ones(2, np.float32)), base, "u", now)
    assert bench.lane.openings()[-4:] == [1.0] * 4


def test_an_interruption_fades_and_closes_from_the_first_frame_that_can_be_taken_back(bench: Bench) -> None:
    now = bench.at(0)
    base = bench.timeline.begin(now)
    bench.timeline.place(piece(0, 100), base, "u", now)
    now = bench.at(10)
    bench.sound(now)
    end = bench.timeline.interrupt(now, "u")
    assert end == 11 + CLOSE_FRAMES
    assert bench.lane.indices == list(range(end))
    openings = bench.lane.openings()
    assert openings[:11] == [1.0] * 11
    assert openings[11:] == [pytest.approx(closing(n / 3), abs=1e-6) for n in range(1, 4)]
    heard = bench.sound(bench.at(13))
    assert 0 < np.flatnonzero(heard)[-1] < BLOCK_SAMPLES
    bench.timeline.fill(bench.at(13), None)
    assert bench.lane.openings()[end] is None
    assert not bench.lane.jobs[end].payload.keyframe


def test_closing_the_mouth_lets_what_is_placed_be_said(bench: Bench) -> None:
    now = bench.at(0)
    base = bench.timeline.begin(now)
    bench.timeline.place(piece(0, 20), base, "u", now)
    assert bench.timeline.close_mouth(bench.at(5), "u") == base + 20 + EASE_FRAMES
    assert bench.lane.openings()[base + 19 : base + 21] == [1.0, pytest.approx(closing(1 / 6))]


def test_time_that_passes_unwatched_is_skipped_and_the_video_starts_anew(bench: Bench) -> None:
    bench.timeline.fill(bench.at(0), None)
    bench.sound(bench.at(1))
    bench.timeline.stop(bench.at(1))
    assert bench.lane.indices == [0, 1]
    now = bench.at(1000)
    assert len(bench.sound(now)) == BLOCK_SAMPLES
    bench.timeline.fill(now, None)
    restarted = bench.lane.jobs[2]
    assert restarted.index == 1001
    assert restarted.payload.keyframe
    assert restarted.payload.loop_frame == 1001 % 50


def test_after_a_short_stall_silence_is_sent_without_a_gap_and_speech_begins_now(bench: Bench) -> None:
    bench.timeline.fill(bench.at(0), None)
    bench.sound(bench.at(1))
    now = bench.at(8.2)  # the process stood still for 0.28 s
    base = bench.timeline.begin(now)
    assert base == 8  # the one that is due
    assert bench.timeline.place(piece(0, 5), base, "u", now) == 0
    blocks = list(bench.timeline.sound(now))
    assert [position for position, _ in blocks] == [
        n * BLOCK_SAMPLES for n in range(3, bench.clock.due_sample(now) // BLOCK_SAMPLES)
    ]
    assert not np.concatenate([block for _, block in blocks])[: 8 * FRAME_SAMPLES - 3 * BLOCK_SAMPLES].any()


def test_the_phase_of_the_pages_clip_holds_from_the_next_start_of_the_video(bench: Bench) -> None:
    bench.timeline.fill(bench.at(0), None)
    bench.timeline.set_phase(IdlePhase(10.5, 5e11))
    now = bench.at(2)
    bench.sound(now)
    bench.timeline.fill(now, None)
    assert bench.lane.jobs[-1].payload.loop_frame == bench.lane.jobs[-1].index  # no jump
    now = bench.at(500)
    bench.sound(now)
    base = bench.timeline.begin(now)
    bench.timeline.place(piece(0, 5), base, "u", now)
    expected = round(10.5 + (base / FPS + 0.05) * FPS) % 50  # wall clock 5e11 ms is frame 0
    assert bench.timeline.loop_frame(base) == expected
    assert [job.payload.loop_frame for job in bench.lane.jobs[-5:]] == [(expected + n) % 50 for n in range(5)]
