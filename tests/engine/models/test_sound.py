from __future__ import annotations

import numpy as np
import pytest

from app.engine.models.mfcc import RATE, mfcc
from app.engine.models.sound import TRACK_STEP, Sound
from app.errors import InputError

FPS = 25


def clicks(*times: float, rate: int = RATE, seconds: float = 2.0) -> np.ndarray:
    samples = np.zeros(round(seconds * rate), np.float32)
    for time in times:
        samples[round(time * rate)] = 1.0
    return samples


def loud(rows: np.ndarray) -> list[int]:
    return [int(row) for row in np.flatnonzero(rows[:, 0] > rows[:, 0].min() + 1)]


def test_a_frame_hears_what_is_around_its_time() -> None:
    assert loud(Sound(clicks(0.4, 1.2), RATE).frames(50, FPS)) == [10, 30]


def test_the_clock_of_the_frames_may_begin_elsewhere() -> None:
    assert loud(Sound(clicks(0.4), RATE, start=0.2).frames(50, FPS)) == [15]
    assert loud(Sound(clicks(0.4), RATE).moved(0.2).frames(50, FPS)) == [5]


def test_rows_of_the_track_belong_to_their_frame() -> None:
    rows = loud(Sound(clicks(0.4), RATE).track(50, FPS))
    assert len(Sound(clicks(0.4), RATE).track(50, FPS)) == 400
    heard = np.mean(rows)  # the click is in the middle of frame 10: between its rows 83 and 84
    assert abs(heard - 83.5) <= 0.5
    assert len(rows) == pytest.approx(0.025 / TRACK_STEP, abs=1)


@pytest.mark.parametrize("rate", [8_000, 24_000, 44_100, 48_000])
def test_other_rates_are_heard_alike(rate: int) -> None:
    random = np.random.default_rng(0)
    t = np.arange(rate) / rate
    wave = sum(a * np.sin(2 * np.pi * f * t) for f, a in ((200, 0.3), (900, 0.2), (2500, 0.1)))
    hiss = 1e-3 * random.standard_normal(rate)
    sound = Sound((wave + hiss).astype(np.float32), rate)
    assert len(sound.heard) == pytest.approx(RATE, abs=2)
    again = mfcc(Sound((wave + hiss).astype(np.float32), rate).heard, np.arange(25) / np.float64(FPS), window=1 / FPS)
    assert np.array_equal(sound.frames(25, FPS), again)
    assert len(set(loud(sound.frames(60, FPS)))) == 26  # frames 0 to 25 hear some of the second that there is


def test_numbers_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="not finite"):
        Sound(np.array([0.0, np.nan], np.float32), RATE)
