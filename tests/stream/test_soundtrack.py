from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.stream.soundtrack import FADE_SAMPLES, Soundtrack, resample


def ones(count: int) -> np.ndarray:
    return np.ones(count, np.float32)


@given(gaps=st.lists(st.tuples(st.integers(0, 50), st.integers(0, 60)), max_size=8), reads=st.lists(st.integers(1, 40)))
def test_reading_in_any_blocks_gives_the_pieces_with_silence_between(
    gaps: list[tuple[int, int]], reads: list[int]
) -> None:
    whole = np.zeros(2000, np.float32)
    track = Soundtrack()
    position = 0
    for number, (gap, count) in enumerate(gaps, 1):
        position += gap
        whole[position : position + count] = number
        track.add(position, np.full(count, number, np.float32))
        position += count
    at = 0
    for count in reads:
        np.testing.assert_array_equal(track.read(at, count), whole[at : at + count])
        at += count
    np.testing.assert_array_equal(track.read(at, 800), whole[at : at + 800])
    assert track.end == 0


def test_pieces_must_not_overlap() -> None:
    track = Soundtrack()
    track.add(10, ones(10))
    with pytest.raises(ValueError, match="overlaps"):
        track.add(19, ones(1))
    track.add(20, ones(1))


def test_a_cut_fades_out_in_20_milliseconds_and_forgets_the_rest() -> None:
    track = Soundtrack()
    track.add(0, ones(5000))
    track.add(5000, ones(5000))
    track.read(0, 1000)
    assert track.cut(1000) == 1000 + FADE_SAMPLES
    after = track.read(1000, 9000)
    assert after[0] == 1.0
    assert np.all(np.diff(after[:FADE_SAMPLES]) < 0)
    assert not after[FADE_SAMPLES:].any()


def test_a_cut_in_silence_is_at_once() -> None:
    track = Soundtrack()
    track.add(9000, ones(10))
    assert track.cut(100) == 100
    assert track.end == 0


@pytest.mark.parametrize("rate", [16_000, 22_050, 24_000, 48_000])
def test_resampling_keeps_tone_and_exact_length(rate: int) -> None:
    seconds = 0.5
    tone = np.sin(2 * np.pi * 1000 * np.arange(round(rate * seconds)) / rate).astype(np.float32)
    made = resample(tone, rate, 24_001)
    assert made.shape == (24_001,)
    assert made.dtype == np.float32
    expected = np.sin(2 * np.pi * 1000 * np.arange(24_000) / 48_000)
    np.testing.assert_allclose(made[1000:23_000], expected[1000:23_000], atol=2e-3)
    assert made[-1] == 0
    assert resample(tone, rate, 23_990).shape == (23_990,)
