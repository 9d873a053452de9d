import numpy as np
import pytest

from app.align.boundaries import activity, settle
from app.align.phoneset import Sound

RATE = 16_000


def tone(*parts: tuple[float, float]) -> np.ndarray:
    """(seconds, amplitude) after each other, as a 200 Hz tone."""
    amplitude = np.concatenate([np.full(round(seconds * RATE), level) for seconds, level in parts])
    return (amplitude * np.sin(2 * np.pi * 200 * np.arange(len(amplitude)) / RATE)).astype(np.float32)


def gapless(sounds: list[Sound], duration: float) -> bool:
    edges = [0.0, *(sound.end for sound in sounds)]
    return [sound.start for sound in sounds] == edges[:-1] and edges[-1] == pytest.approx(duration)


def test_activity_finds_where_sound_is() -> None:
    times, loud = activity(tone((0.3, 0.0), (0.4, 0.5), (0.3, 0.0)), RATE)
    assert times[loud][0] == pytest.approx(0.3, abs=0.02)
    assert times[loud][-1] == pytest.approx(0.7, abs=0.02)
    assert activity(np.zeros(3, np.float32), RATE)[0].shape == (0,)


def test_times_move_by_the_lag() -> None:
    samples = tone((1.0, 0.5))
    sounds = [Sound("AA", 0.0, 0.5), Sound("M", 0.5, 1.0)]
    settled = settle(sounds, samples, RATE, lag=0.05)
    assert settled[0].end == pytest.approx(0.45)
    assert gapless(settled, 1.0)


def test_a_short_gap_is_divided_and_a_pause_is_kept() -> None:
    samples = tone((0.5, 0.5), (0.5, 0.0), (1.0, 0.5))
    sounds = [
        Sound("AA", 0.0, 0.5, 0),
        Sound("SIL", 0.5, 1.0),
        Sound("B", 1.0, 1.4, 1),
        Sound("SIL", 1.4, 1.5),
        Sound("IY", 1.5, 2.0, 2),
    ]
    settled = settle(sounds, samples, RATE, lag=0.0)
    assert [sound.symbol for sound in settled] == ["AA", "SIL", "B", "IY"]
    assert settled[2].end == pytest.approx(1.45)
    assert gapless(settled, 2.0)


def test_the_last_phone_ends_where_the_energy_does() -> None:
    samples = tone((0.2, 0.0), (0.6, 0.5), (0.7, 0.0))
    sounds = [Sound("SIL", 0.0, 0.2), Sound("AA", 0.2, 1.1), Sound("SIL", 1.1, 1.5)]
    settled = settle(sounds, samples, RATE, lag=0.0)
    assert settled[1].end == pytest.approx(0.8, abs=0.02)
    assert gapless(settled, 1.5)


def test_a_phone_after_a_pause_begins_with_the_energy() -> None:
    samples = tone((0.25, 0.0), (0.75, 0.5))
    sounds = [Sound("SIL", 0.0, 0.2), Sound("AA", 0.2, 1.0)]
    assert settle(sounds, samples, RATE, lag=0.0)[1].start == pytest.approx(0.25, abs=0.02)


@pytest.mark.parametrize("seed", range(20))
def test_anything_stays_gapless_and_in_order(seed: int) -> None:
    chance = np.random.default_rng(seed)
    edges = np.concatenate([[0.0], np.cumsum(chance.uniform(0.01, 0.4, 12))])
    symbols = chance.choice(["AA", "B", "SIL"], 12)
    sounds: list[Sound] = []
    for at, symbol in enumerate(symbols):
        if sounds and sounds[-1].symbol == symbol == "SIL":
            sounds[-1] = Sound("SIL", sounds[-1].start, edges[at + 1])
        else:
            sounds.append(Sound(str(symbol), edges[at], edges[at + 1]))
    samples = tone(*((0.05, level) for level in chance.choice([0.0, 0.5], int(edges[-1] / 0.05))))
    settled = settle(sounds, samples, RATE, lag=0.047)
    assert gapless(settled, len(samples) / RATE)
    assert all(sound.end > sound.start for sound in settled)
