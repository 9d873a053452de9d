import numpy as np
import pytest

from app.align.phoneset import Sound
from app.speech import SILENCE, Word
from app.tts.take import LEAD, TAIL, Take, joined, trimmed, words_of

RATE = 16_000


def take(before: float, loud: float, after: float) -> Take:
    tone = 0.5 * np.sin(np.arange(round(loud * RATE)) * 0.3)
    samples = np.concatenate([np.zeros(round(before * RATE)), tone, np.zeros(round(after * RATE))]).astype(np.float32)
    middle, end = before + loud / 2, before + loud
    sounds = [Sound(SILENCE, 0.0, before), Sound("M", before, middle, 0), Sound("AA", middle, end, 1)]
    return Take(samples, [*sounds, Sound(SILENCE, end, end + after)])


@pytest.mark.parametrize(("before", "after"), [(0.5, 0.5), (0.01, 0.02), (0.3, 0.01)])
def test_silence_at_the_ends_is_cut_or_added(before: float, after: float) -> None:
    result = trimmed(take(before, 0.4, after), RATE)
    assert result is not None
    edges = [(sound.symbol, round(sound.start, 2), round(sound.end, 2)) for sound in result.sounds]
    assert [symbol for symbol, _, _ in edges] == [SILENCE, "M", "AA", SILENCE]
    assert result.sounds[0].end == pytest.approx(LEAD, abs=0.015)
    assert result.sounds[-1].end == pytest.approx(len(result.samples) / RATE)
    assert result.sounds[-1].end - result.sounds[-1].start == pytest.approx(TAIL, abs=0.001)
    assert result.sounds[2].end - result.sounds[1].start == pytest.approx(0.4, abs=0.03)


def test_silence_alone_is_nothing() -> None:
    assert trimmed(Take(np.zeros(RATE, np.float32), [Sound(SILENCE, 0.0, 1.0)]), RATE) is None


def test_joined() -> None:
    samples, sounds = joined([take(0.1, 0.2, 0.1), take(0.1, 0.2, 0.1)], RATE)
    assert len(samples) == round(0.8 * RATE)
    assert [sound.symbol for sound in sounds] == [SILENCE, "M", "AA", SILENCE, "M", "AA", SILENCE]
    assert (sounds[3].start, sounds[3].end) == pytest.approx((0.3, 0.5))


def test_words() -> None:
    sounds = [Sound("M", 0, 1, 0), Sound("AA", 1, 2, 0), Sound(SILENCE, 2, 3), Sound("B", 3, 4, 2)]
    written = [("ma", range(1)), ("-", range(1, 2)), ("b", range(2, 3))]
    assert words_of(sounds, written) == (Word("ma", 0, 2), Word("b", 3, 4))
    assert words_of(sounds, [("both", range(3))]) == (Word("both", 0, 4),)
