from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.align.pauses import CLOSURE, close_gaps, trim
from app.align.phoneset import Sound

RATE = 16_000


def room(seconds: float, level: float = 0.001) -> np.ndarray:
    return (level * np.random.default_rng(1).standard_normal(round(seconds * RATE))).astype(np.float32)


def speech(*loud: tuple[float, float], seconds: float = 2.0, rumble: float = 0.0) -> np.ndarray:
    """Noise of a room with loud stretches from-to (seconds), and rumble far below any voice."""
    samples = room(seconds)
    for start, end in loud:
        span = slice(round(start * RATE), round(end * RATE))
        samples[span] += 0.2 * np.random.default_rng(2).standard_normal(span.stop - span.start).astype(np.float32)
    return samples + (rumble * np.sin(2 * np.pi * 15 * np.arange(len(samples)) / RATE)).astype(np.float32)


def line(*edges: float, symbols: str = "SIL S AA N SIL") -> list[Sound]:
    return [
        Sound(symbol, start, end, 0 if symbol != "SIL" else -1)
        for symbol, (start, end) in zip(symbols.split(), pairwise(edges), strict=True)
    ]


@pytest.mark.parametrize("rumble", [0.0, 0.3])
@pytest.mark.parametrize(("start", "end"), [(0.3, 1.7), (0.55, 1.45)])
def test_edges_go_to_where_the_energy_is(start: float, end: float, rumble: float) -> None:
    sounds = trim(line(0, start, 0.7, 1.3, end, 2), speech((0.5, 1.5), rumble=rumble), RATE)
    assert sounds[1].start == pytest.approx(0.5, abs=0.015)
    assert sounds[3].end == pytest.approx(1.5, abs=0.015)
    assert [sound.start for sound in sounds[2:4]] == [0.7, 1.3]


def test_clicks_before_the_speech_are_left_out() -> None:
    sounds = trim(line(0, 0.2, 0.7, 1.3, 1.5, 2), speech((0.25, 0.27), (0.5, 1.5)), RATE)
    assert sounds[1].start == pytest.approx(0.5, abs=0.015)


def test_stops_begin_closed_and_end_released() -> None:
    sounds = trim(line(0, 0.3, 0.7, 1.3, 1.4, 2, symbols="SIL B AA T SIL"), speech((0.5, 1.35), (1.43, 1.46)), RATE)
    assert sounds[1].start == pytest.approx(0.5 - CLOSURE, abs=0.015)
    assert sounds[3].end == pytest.approx(1.46, abs=0.015)


def test_weak_fricatives_are_not_cut_away() -> None:
    sounds = trim(line(0, 0.3, 0.5, 1.3, 1.5, 2, symbols="SIL F AA N SIL"), speech((0.5, 1.5)), RATE)
    assert sounds[1].start == pytest.approx(0.42)


def test_a_first_phone_that_swallowed_the_lead_gives_it_back() -> None:
    sounds = trim(line(0, 0.7, 1.3, 2, symbols="S AA N"), speech((0.5, 1.5)), RATE)
    assert [sound.symbol for sound in sounds] == ["SIL", "S", "AA", "N", "SIL"]
    assert sounds[0].end == pytest.approx(0.5, abs=0.015)
    assert sounds[3].end == pytest.approx(1.5, abs=0.015)


def test_short_pauses_inside_stay() -> None:
    before = line(0, 0.5, 1.0, 1.1, 1.5, 2, symbols="SIL S SIL N SIL")
    after = trim(before, speech((0.5, 0.95), (1.15, 1.5)), RATE)
    assert after[2] == before[2]


def test_silence_and_very_short_sound_change_nothing() -> None:
    sounds = line(0, 0.5, 0.7, 1.3, 1.5, 2)
    assert trim(sounds, np.zeros(2 * RATE, np.float32), RATE)[1:4] == sounds[1:4]
    assert trim(sounds, np.zeros(10, np.float32), RATE) == sounds


@given(
    st.lists(st.tuples(st.sampled_from(["SIL", "B", "F", "AA", "S"]), st.floats(0.01, 0.4)), min_size=1, max_size=10),
    st.integers(0, 5),
)
def test_phones_stay_gapless_and_in_order(spans: list[tuple[str, float]], seed: int) -> None:
    edges = np.concatenate([[0.0], np.cumsum([length for _, length in spans])]).tolist()
    sounds = [Sound(symbol, a, b) for (symbol, _), (a, b) in zip(spans, pairwise(edges), strict=True)]
    merged = [sound for before, sound in pairwise([Sound("", 0, 0), *sounds]) if sound.symbol != before.symbol]
    merged = [replace(a, end=b.start) for a, b in pairwise([*merged, Sound("", edges[-1], edges[-1])])]
    generator = np.random.default_rng(seed)
    samples = (
        generator.standard_normal(round(edges[-1] * RATE))
        * np.repeat(generator.choice([0.0, 0.001, 0.3], 20), len(range(0, round(edges[-1] * RATE), 20)) // 1)[
            : round(edges[-1] * RATE)
        ]
    )
    trimmed = trim(close_gaps(merged), samples.astype(np.float32), RATE)
    assert trimmed[0].start == 0
    assert trimmed[-1].end == edges[-1]
    assert all(a.end == b.start and a.end > a.start for a, b in pairwise(trimmed))
    spoken = [sound.symbol for sound in merged if sound.symbol != "SIL"]
    assert [sound.symbol for sound in trimmed if sound.symbol != "SIL"] == spoken


def test_short_gaps_are_divided() -> None:
    closed = close_gaps(line(0, 0.02, 0.3, 0.34, 0.6, 0.62, symbols="SIL S SIL N SIL"))
    assert [(sound.symbol, sound.start, sound.end) for sound in closed] == [
        ("SIL", 0, 0.02),
        ("S", 0.02, pytest.approx(0.32)),
        ("N", pytest.approx(0.32), 0.6),
        ("SIL", 0.6, 0.62),
    ]
