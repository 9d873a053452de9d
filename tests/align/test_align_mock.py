import numpy as np
import pytest

from app.align.aligner import DOUBTFUL, Aligner
from app.align.dictionary import Dictionary
from app.align.mock import MockAligner
from app.errors import NothingToSay

RATE = 16_000


def burst(lead: float, length: float, tail: float) -> np.ndarray:
    """Silence, a hum, silence (seconds)."""
    hum = 0.3 * np.sin(2 * np.pi * 200 * np.arange(round(length * RATE)) / RATE)
    return np.concatenate([np.zeros(round(lead * RATE)), hum, np.zeros(round(tail * RATE))]).astype(np.float32)


def test_phones_are_spread_over_the_loud_part() -> None:
    aligner = MockAligner(Dictionary({"hum": "HH AH M"}))
    assert isinstance(aligner, Aligner)
    result = aligner.align(burst(0.5, 0.6, 0.4), RATE, "Hum hum.")
    assert [phone.symbol for phone in result.phones] == ["SIL", "HH", "AH", "M", "HH", "AH", "M", "SIL"]
    assert result.phones[0].end == pytest.approx(0.5, abs=0.02)
    assert result.phones[-1].start == pytest.approx(1.1, abs=0.02)
    assert result.phones[-1].end == 1.5
    lengths = [phone.end - phone.start for phone in result.phones[1:-1]]
    assert lengths == pytest.approx([lengths[0]] * 6)
    assert [word.text for word in result.words] == ["Hum", "hum."]
    assert result.words[0].end == result.words[1].start


def test_the_same_input_gives_the_same_times() -> None:
    assert MockAligner().align(burst(0.1, 1, 0.1), RATE, "hello you") == MockAligner().align(
        burst(0.1, 1, 0.1), RATE, "hello you"
    )


def test_a_text_that_does_not_fit_into_the_time_is_doubtful() -> None:
    assert MockAligner().align(burst(0.1, 0.5, 0.1), RATE, "hello").confidence > DOUBTFUL
    assert MockAligner().align(burst(0.1, 0.5, 0.1), RATE, "hello " * 20).confidence < DOUBTFUL


def test_silence_is_all_loud_part() -> None:
    result = MockAligner().align(np.zeros(RATE, np.float32), RATE, "hello")
    assert result.phones[-1].end == 1.0


def test_nothing_that_sounds() -> None:
    with pytest.raises(NothingToSay):
        MockAligner().align(burst(0.1, 1, 0.1), RATE, "… 😀")
