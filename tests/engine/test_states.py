from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.engine.states import (
    MOST_STATES,
    NEAREST,
    NEIGHBOUR,
    SILENCE_STEP,
    VISEMES,
    Segment,
    occupancy,
    parent,
    plain,
    segments,
    viseme,
)
from app.speech import PHONES, SILENCE, Phone


@st.composite
def phone_sequences(draw: st.DrawFn, shortest: float = 0.025) -> list[Phone]:
    """Gapless phones, none shorter than a speech engine's shortest."""
    symbols = draw(st.lists(st.sampled_from(PHONES), min_size=1, max_size=25))
    lengths = draw(st.lists(st.floats(shortest, 0.6), min_size=len(symbols), max_size=len(symbols)))
    edges = np.concatenate([[0], np.cumsum(lengths)])
    return [
        Phone(symbol, float(a), float(b)) for symbol, (a, b) in zip(symbols, itertools.pairwise(edges), strict=True)
    ]


def spread(sequence: list[Segment], frames: int, fps: float = 25, lead: float = 0.05, cap: float = 12.0):  # type: ignore[no-untyped-def]
    names = {state: index for index, state in enumerate(sorted({segment.state for segment in sequence}))}
    return names, occupancy(sequence, names, frames, fps=fps, lead=lead, cap=cap)


@given(phone_sequences())
@settings(max_examples=100, deadline=None)
def test_segments_are_the_same_time_without_gaps(phones: list[Phone]) -> None:
    split = segments(phones)
    assert abs(split[0].start - phones[0].start) < 1e-9
    assert abs(split[-1].end - phones[-1].end) < 1e-9
    for here, following in itertools.pairwise(split):
        assert abs(here.end - following.start) < 1e-9
        assert here.end > here.start - 1e-9


@given(phone_sequences(), st.integers(1, 120), st.sampled_from([24.0, 25.0, 29.97, 50.0]), st.floats(0, 0.1))
@settings(max_examples=100, deadline=None)
def test_every_frame_is_shared_out_entirely(phones: list[Phone], frames: int, fps: float, lead: float) -> None:
    _, shown = spread(segments(phones), frames, fps, lead)
    assert shown.share.shape == shown.states.shape == shown.duration.shape == (frames, MOST_STATES)
    assert (shown.share >= 0).all()
    np.testing.assert_allclose(shown.share.sum(1), 1, atol=1e-6)
    assert (shown.duration >= 0.5).all()
    assert (shown.duration <= 12).all()


@given(phone_sequences(), st.integers(1, 60))
@settings(max_examples=60, deadline=None)
def test_shares_are_the_overlaps_of_frames_and_segments(phones: list[Phone], frames: int) -> None:
    sequence = segments(phones)
    names, shown = spread(sequence, frames)
    expected = np.zeros((frames, len(names)))
    for number, segment in enumerate(sequence):
        start = -np.inf if number == 0 else segment.start
        end = np.inf if number == len(sequence) - 1 else segment.end
        for n in range(frames):
            seen = n / 25 + 0.05
            expected[n, names[segment.state]] += max(0, min(end, seen + 0.02) - max(start, seen - 0.02)) * 25
    found = np.zeros_like(expected)
    for slot in range(MOST_STATES):
        np.add.at(found, (np.arange(frames), shown.states[:, slot]), shown.share[:, slot])
    np.testing.assert_allclose(found, expected, atol=1e-6)


@given(phone_sequences(shortest=0.001), st.integers(1, 30))
@settings(max_examples=40, deadline=None)
def test_phones_too_short_to_tell_apart_never_weigh_more_than_the_frame(phones: list[Phone], frames: int) -> None:
    _, shown = spread(segments(phones), frames)
    assert (shown.share.sum(1) <= 1 + 1e-6).all()
    assert (shown.share.sum(1) > 0).all()


def test_every_phone_is_two_halves_each_beside_its_neighbours_viseme() -> None:
    spoken = [Phone("B", 0, 0.1), Phone("AE", 0.1, 0.3), Phone("Z", 0.3, 0.34)]
    assert segments(spoken) == [
        Segment("B.0|SIL", 0, 0.05),
        Segment("B.1|AE", 0.05, 0.1),
        Segment("AE.0|P", 0.1, pytest.approx(0.2)),
        Segment("AE.1|S", pytest.approx(0.2), 0.3),
        Segment("Z.0|AE", 0.3, pytest.approx(0.32)),
        Segment("Z.1|SIL", pytest.approx(0.32), 0.34),
    ]


def test_phones_that_look_alike_are_the_same_neighbour() -> None:
    def halves(before: str, after: str) -> list[str]:
        spoken = [Phone(before, 0, 0.1), Phone("IY", 0.1, 0.2), Phone(after, 0.2, 0.3)]
        return [segment.state for segment in segments(spoken)][2:4]

    for before, after in itertools.product(PHONES, PHONES):
        alike = next(each for each in VISEMES if before in each)[0], next(each for each in VISEMES if after in each)[0]
        if SILENCE not in (before, after):
            assert halves(before, after) == halves(*alike)
    assert halves("M", "NG") == ["IY.0|P", "IY.1|K"]


def test_the_first_half_does_not_know_what_follows_nor_the_second_what_was_before() -> None:
    times = [(0, 0.1), (0.1, 0.2), (0.2, 0.3)]
    first = [segments([Phone(s, *t) for s, t in zip(("M", "AA", x), times, strict=True)])[2] for x in ("S", "UW", "L")]
    second = [segments([Phone(s, *t) for s, t in zip((x, "AA", "M"), times, strict=True)])[3] for x in ("S", "UW", "L")]
    assert len(set(first)) == len(set(second)) == 1


@given(phone_sequences())
@settings(max_examples=60, deadline=None)
def test_parents_and_plain_names_of_whatever_is_said(phones: list[Phone]) -> None:
    symbols = {phone.symbol for phone in phones}
    for segment in segments(phones):
        state, family, phone = segment.state, parent(segment.state), plain(segment.state)
        assert state in (family, f"{family}{NEIGHBOUR}{state.rpartition(NEIGHBOUR)[2]}")
        assert parent(family) == family
        assert plain(family) == plain(phone) == phone
        assert viseme(state) == viseme(family) == viseme(phone)
        if state.startswith(SILENCE):
            assert phone == family
        else:
            assert family in (f"{phone}.0", f"{phone}.1")
            assert phone in symbols


def test_parents_and_plain_names() -> None:
    for state, family, phone in (
        ("AE.0|P", "AE.0", "AE"), ("AE.1", "AE.1", "AE"), ("SIL.after2|AA", "SIL.after2", "SIL.after2"),
        ("SIL", "SIL", "SIL"),
    ):  # fmt: skip
        assert (parent(state), plain(state)) == (family, phone)


def silences(seconds: float, before: bool, after: bool) -> list[str]:
    phones = [Phone("M", -1, 0)] * before + [Phone(SILENCE, 0, seconds)] + [Phone("M", seconds, seconds + 1)] * after
    return [parent(segment.state) for segment in segments(phones) if segment.state.startswith(SILENCE)]


def test_silence_is_split_by_its_distance_to_speech() -> None:
    after = [f"SIL.after{k}" for k in range(4)]
    before = [f"SIL.before{k}" for k in (3, 2, 1, 0)]
    assert silences(1, before=True, after=True) == [*after, "SIL", *before]
    assert silences(1, before=True, after=False) == [*after, "SIL"]
    assert silences(1, before=False, after=True) == ["SIL", *before]
    assert silences(1, before=False, after=False) == ["SIL"]
    assert silences(0.2, before=True, after=True) == ["SIL.after0", "SIL.after1", "SIL.before1", "SIL.before0"]
    assert silences(0.13, before=True, after=True) == ["SIL.after0", "SIL", "SIL.before0"]
    assert silences(0.06, before=True, after=True) == ["SIL"]
    assert silences(0.12, before=True, after=False) == ["SIL.after0", "SIL.after1", "SIL"]


def test_silence_near_speech_knows_what_is_said_there() -> None:
    spoken = [Phone("B", 0, 1), Phone(SILENCE, 1, 1.25), Phone("OY", 1.25, 2)]
    names = [segment.state for segment in segments(spoken)]
    assert names == [
        "B.0|SIL", "B.1|SIL", "SIL.after0|P", "SIL.after1|P", "SIL", "SIL.before1|OW", "SIL.before0|OW", "OY.0|SIL",
        "OY.1|SIL",
    ]  # fmt: skip


def test_silences_in_a_row_are_one() -> None:
    # Else the mouth would open between them, as it does next to speech.
    speech, parts = Phone("M", 0, 1), [Phone(SILENCE, 1, 1.06), Phone(SILENCE, 1.06, 1.3), Phone(SILENCE, 1.3, 2)]
    assert segments([speech, *parts]) == segments([speech, Phone(SILENCE, 1, 2)])
    assert segments(parts) == [Segment(SILENCE, 1, 2)]


def test_the_steps_of_silence_lie_at_their_distance() -> None:
    split = segments([Phone("M", 0, 1), Phone(SILENCE, 1, 2), Phone("M", 2, 3)])
    for segment in split:
        state, number = parent(segment.state)[:-1], parent(segment.state)[-1:]
        if state == "SIL.after":
            assert segment.start == pytest.approx(1 + int(number) * SILENCE_STEP)
        elif state == "SIL.before":
            assert segment.end == pytest.approx(2 - int(number) * SILENCE_STEP)


def test_the_first_and_the_last_segment_go_on_for_ever() -> None:
    names, shown = spread([Segment("AA", 1.0, 1.1), Segment("M", 1.1, 1.2)], 100)
    assert (shown.states[:20, 0] == names["AA"]).all()
    assert (shown.states[40:, 0] == names["M"]).all()
    np.testing.assert_allclose(shown.share[[0, 99], 0], 1)


def test_the_lips_are_ahead_of_the_sound() -> None:
    sequence = [Segment("AA", 0, 1.0), Segment("M", 1.0, 2.0)]
    for lead, half in ((0.0, 25), (0.04, 24), (0.08, 23)):
        names, shown = spread(sequence, 50, lead=lead)
        assert shown.share[half, 0] == pytest.approx(0.5)
        assert shown.states[half + 1, 0] == names["M"]


def test_durations_are_in_frames_and_capped() -> None:
    sequence = [Segment("AA", 0, 2), Segment("M", 2, 2.1), Segment("T", 2.1, 2.105), Segment("AA", 2.105, 4)]
    names, shown = spread(sequence, 100)
    found = {name: set(shown.duration[(shown.states == index) & (shown.share > 0)]) for name, index in names.items()}
    assert found["AA"] == {12.0}
    assert next(iter(found["M"])) == pytest.approx(2.5)
    assert found["T"] == {0.5}


def test_every_phone_has_a_viseme_and_every_spoken_one_a_way_out() -> None:
    assert sorted(itertools.chain(*VISEMES)) == sorted(PHONES)
    for phone in PHONES:
        assert phone in VISEMES[viseme(phone)]
        assert viseme(f"{phone}.1") == viseme(phone)
    assert set(NEAREST) == set(PHONES) - {SILENCE}
    assert SILENCE not in itertools.chain(*NEAREST.values())
    assert set(itertools.chain(*NEAREST.values())) <= set(PHONES)
