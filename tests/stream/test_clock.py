from __future__ import annotations

import pytest

from app.stream.clock import BLOCK_SAMPLES, StreamClock, first_frame_at


def test_frames_and_samples() -> None:
    assert [first_frame_at(sample) for sample in (0, 1, 1919, 1920, 1921)] == [0, 1, 1, 1, 2]


def test_time_is_computed_from_numbers_and_does_not_drift() -> None:
    clock = StreamClock(lambda: 1000.1, lambda: 5e8)
    assert clock.frame_release(0) == 1000.1
    assert clock.frame_release(25 * 3600 * 24) == pytest.approx(1000.1 + 86_400, abs=1e-9)
    assert clock.sample_release(48_000 * 3600) == pytest.approx(1000.1 + 3600, abs=1e-9)
    assert clock.wall_ms(2.0) == 5e11 + 2000


def test_sound_is_due_in_whole_blocks_from_the_first_moment_on() -> None:
    clock = StreamClock(lambda: 1000.0)
    assert clock.due_sample(1000.0) == BLOCK_SAMPLES
    assert clock.due_sample(1000.0199) == BLOCK_SAMPLES
    assert clock.due_sample(1000.5) == 26 * BLOCK_SAMPLES
    for block in range(1, 5000):  # a timer that fires exactly in time finds its block due
        assert clock.due_sample(clock.sample_release(block * BLOCK_SAMPLES)) == (block + 1) * BLOCK_SAMPLES
