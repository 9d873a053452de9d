from __future__ import annotations

import numpy as np
import pytest
from filmed import FPS, silence, spoken
from hypothesis import given, settings
from hypothesis import strategies as st

from app.engine.training.take import LEAST_PASSAGE, PAUSE, check_phones, passages, resting, speaking
from app.errors import TrainingFailed
from app.speech import SILENCE, Phone


def phones(*timed: tuple[str, float]) -> tuple[Phone, ...]:
    ends = np.cumsum([length for _, length in timed]).tolist()
    return tuple(Phone(symbol, end - length, end) for (symbol, length), end in zip(timed, ends, strict=True))


TALK = phones((SILENCE, 0.6), ("AA", 3.0), (SILENCE, 1.0), ("M", 3.0), (SILENCE, 0.2), ("AA", 3.0), (SILENCE, 0.8))


def test_takes_are_divided_in_the_middle_of_long_silences() -> None:
    assert passages(TALK, 290) == [range(102), range(102, 290)]
    assert passages(silence(100), 100) == [range(100)]


def test_no_short_passage_is_divided_off() -> None:
    short = phones((SILENCE, 0.6), ("AA", 1.0), (SILENCE, 0.6), ("M", 3.0), (SILENCE, 0.6), ("AA", 1.0), (SILENCE, 0.4))
    assert passages(short, 180) == [range(180)]


lengths = st.lists(st.tuples(st.sampled_from(["AA", "M", SILENCE]), st.floats(0.05, 3.5)), min_size=1, max_size=14)


@given(lengths, st.integers(-20, 20))
@settings(max_examples=100, deadline=None)
def test_passages_are_all_of_a_take(timed: list[tuple[str, float]], more: int) -> None:
    said = phones(*timed)
    frames = max(1, round(said[-1].end * FPS) + more)
    found = passages(said, frames)
    assert [number for span in found for number in span] == list(range(frames))
    if len(found) > 1:
        whole = found if frames >= round(said[-1].end * FPS) else found[:-1]  # the picture may end before the sound
        assert min(len(span) for span in whole) >= LEAST_PASSAGE * FPS - 1
        middles = {round((phone.start + phone.end) / 2 * FPS) for phone in said if phone.end - phone.start >= PAUSE}
        assert {span.start for span in found[1:]} <= middles


@given(lengths)
@settings(max_examples=100, deadline=None)
def test_a_mouth_that_rests_does_not_speak(timed: list[tuple[str, float]]) -> None:
    said = phones(*timed)
    frames = round(said[-1].end * FPS) + 5
    rest, speech = resting(said, frames), speaking(said, frames)
    assert rest.shape == speech.shape == (frames,)
    edges = [phone for phone in said if phone.symbol != SILENCE]
    for number in np.flatnonzero(rest):
        assert all(not phone.start < number / FPS < phone.end for phone in edges)
    assert rest[-1] == (said[-1].symbol == SILENCE and (len(said) == 1 or (frames - 1) / FPS >= said[-1].start + 0.3))


def test_the_mouth_needs_time_to_come_to_rest_and_to_leave_it() -> None:
    rest = resting(TALK, 290)
    assert rest[:11].all()  # nobody spoke before
    assert not rest[12:98].any()
    assert rest[98:111].all()  # 0.3 s after one phone, 0.16 s before the next
    assert not rest[112:278].any()  # 0.2 s are no rest
    assert rest[278:].all()


def test_speaking_is_every_phone_but_silence() -> None:
    spoke = speaking(TALK, 290)
    np.testing.assert_array_equal(np.flatnonzero(np.diff(spoke.astype(int))) + 1, [15, 90, 115, 190, 195, 270])


def test_phones_of_a_real_recording_are_right() -> None:
    check_phones(spoken(200), "Mary")
    check_phones(TALK, "here")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ((), "here holds no phones"),
        ((Phone("AA1", 0, 1),), "phone 0 is 'AA1', which is not ARPAbet without stress"),
        ((Phone("AA", 0, 1), Phone("M", 1.1, 2)), r"phone 1 \(M\) does not start where the last one ends"),
        ((Phone("AA", 1, 0.5),), r"phone 0 \(AA\)"),
    ],
)
def test_wrong_phones(wrong: tuple[Phone, ...], message: str) -> None:
    with pytest.raises(TrainingFailed, match=message):
        check_phones(wrong, "here")
