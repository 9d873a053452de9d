from collections.abc import Sequence

import numpy as np
import pytest

from app.align.recogniser import CHUNK, RATE, Heard, Samples, phones, recognise
from app.speech import SILENCE


def hum(seconds: float, loudness: float = 0.3) -> Samples:
    return (loudness * np.sin(2 * np.pi * 200 * np.arange(round(seconds * RATE)) / RATE)).astype(np.float32)


def quiet(seconds: float) -> Samples:
    return np.zeros(round(seconds * RATE), np.float32)


class Listener:
    """Hears an M in the middle of every second of the whole recording, wherever its window is cut from it."""

    name = "listener"

    def __init__(self, whole: Samples) -> None:
        self.whole = whole
        self.longest = 0

    def warm_up(self) -> None: ...

    def hear(self, samples: Samples) -> Sequence[Heard]:
        self.longest = max(self.longest, len(samples))
        start = round(float(samples[0]) * 1e6)  # the samples are numbered
        end = start + len(samples)
        middles = range(RATE // 2, len(self.whole), RATE)
        return [Heard("M", (middle - start) / RATE) for middle in middles if start <= middle < end]


def test_borders_lie_midway_and_beside_pauses_where_the_energy_is() -> None:
    sound = np.concatenate([quiet(0.5), hum(0.3), quiet(0.5)])
    result = phones([Heard("M", 0.55), Heard("AA", 0.65), Heard("P", 0.75)], sound)
    assert [phone.symbol for phone in result] == [SILENCE, "M", "AA", "P", SILENCE]
    assert result[0].start == 0
    assert result[-1].end == 1.3
    assert [before.end for before in result[:-1]] == [after.start for after in result[1:]]
    assert result[1].end == pytest.approx(0.6)
    assert result[2].end == pytest.approx(0.7)
    assert result[1].start == pytest.approx(0.5, abs=0.03)
    assert result[3].end == pytest.approx(0.8, abs=0.03)


def test_nothing_heard_is_silence_and_no_sound_has_no_phones() -> None:
    (only,) = phones([], hum(0.4))
    assert (only.symbol, only.start, only.end) == (SILENCE, 0.0, 0.4)
    assert phones([], quiet(0)) == []


def test_a_phone_outside_of_the_sound_is_left_out() -> None:
    result = phones([Heard("M", 0.2), Heard("AA", 0.9)], hum(0.5))
    assert "AA" not in [phone.symbol for phone in result]
    assert result[-1].end == 0.5


def test_a_long_recording_is_heard_in_pieces_and_no_phone_twice() -> None:
    whole = (np.arange(round(25 * RATE)) / 1e6).astype(np.float32)
    listener = Listener(whole)
    result = recognise(listener, whole)
    assert [phone.symbol for phone in result].count("M") == 25
    assert listener.longest < 2 * CHUNK * RATE
    assert result[-1].end == pytest.approx(25)


def test_an_empty_recording_has_no_phones() -> None:
    assert recognise(Listener(quiet(0)), quiet(0)) == ()
