from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.align.aligner import assemble, checked
from app.align.phoneset import Sound
from app.errors import InputError, NothingToSay
from app.speech import Phone, Word


def test_silence_fills_the_gaps_and_words_span_their_phones() -> None:
    sounds = [Sound("HH", 0.2, 0.3, 0), Sound("AY", 0.3, 0.5, 0), Sound("SIL", 0.5, 0.6), Sound("M", 0.7, 0.8, 2)]
    result = assemble(sounds, ["Hi,", "…", "Mum!"], 1.0, guessed=["Mum!", "Mum!"], confidence=0.25)
    assert result.phones == (
        Phone("SIL", 0.0, 0.2),
        Phone("HH", 0.2, 0.3),
        Phone("AY", 0.3, 0.5),
        Phone("SIL", 0.5, 0.7),
        Phone("M", 0.7, 0.8),
        Phone("SIL", 0.8, 1.0),
    )
    assert result.words == (Word("Hi,", 0.2, 0.5), Word("Mum!", 0.7, 0.8))
    assert (result.guessed, result.confidence) == (("Mum!",), 0.25)


@given(st.lists(st.tuples(st.sampled_from(["AA", "T", "SIL"]), st.floats(-1, 3), st.floats(0, 0.5)), max_size=12))
def test_phones_always_cover_the_sound(spans: list[tuple[str, float, float]]) -> None:
    sounds = [Sound(symbol, start, start + length) for symbol, start, length in spans]
    phones = assemble(sounds, [], 2.0).phones
    assert phones[0].start == 0
    assert phones[-1].end == 2.0
    assert all(before.end == after.start for before, after in pairwise(phones))
    assert all(phone.end > phone.start for phone in phones)


@pytest.mark.parametrize(
    ("samples", "rate"),
    [
        (np.zeros(0, np.float32), 16_000),
        (np.zeros((2, 100), np.float32), 16_000),
        (np.zeros(100, np.float32), 0),
        (np.full(100, np.nan, np.float32), 16_000),
    ],
)
def test_unusable_sound_is_refused(samples: np.ndarray, rate: int) -> None:
    with pytest.raises(InputError):
        checked(samples, rate, "hello")


def test_no_text_is_refused() -> None:
    with pytest.raises(NothingToSay):
        checked(np.zeros(100, np.float32), 16_000, " \n")
