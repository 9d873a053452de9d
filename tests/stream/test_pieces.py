from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from puppet import FPS, TinyAvatar, speech

from app.engine.avatar import load_avatar
from app.speech import SILENCE, Mark, Phone, Speech, Word
from app.stream.clock import FRAME_SAMPLES
from app.stream.pieces import REST_FRAMES, pieces, to_rest


@settings(max_examples=50, deadline=None)
@given(
    lengths=st.lists(st.tuples(st.floats(0.003, 0.9), st.floats(0.001, 0.3)), min_size=1, max_size=12),
    rate=st.sampled_from([16_000, 22_050, 24_000]),
)
def test_frame_n_shows_what_sounds_n_over_fps_after_the_start(lengths: list[tuple[float, float]], rate: int) -> None:
    avatar = TinyAvatar()
    speeches = [speech(("AA", voiced), (SILENCE, silent), rate=rate) for voiced, silent in lengths]
    made = list(pieces(avatar, iter(speeches)))

    sample = frame = 0
    for piece in made:  # joined end to end, without a gap
        assert (piece.sample, piece.frame) == (sample, frame)
        sample += len(piece.samples)
        frame += len(piece.coefficients)
    assert sample == frame * FRAME_SAMPLES
    assert len(made) == len(speeches) + 1
    spoken = sum(each.duration for each in speeches)
    assert -1e-4 < sample / 48_000 - spoken - REST_FRAMES / FPS < 1 / FPS + 1e-4

    mouth = np.concatenate([piece.coefficients for piece in made])[:, 0]
    edges = np.cumsum([0.0, *(p.end - p.start for each in speeches for p in each.phones)])
    for n in range(frame - REST_FRAMES):
        if np.abs(edges - n / FPS).min() > 1 / rate:  # which side of an edge a frame falls on may be rounding
            inside = np.searchsorted(edges, n / FPS) - 1
            voiced = inside < 2 * len(speeches) and inside % 2 == 0
            assert (mouth[n] == 1) == voiced, (n, edges)  # in a silence it may still be closing


def test_each_piece_continues_from_the_frames_before_and_the_last_comes_to_rest() -> None:
    avatar = TinyAvatar()
    made = list(pieces(avatar, [speech(("AA", 0.12)), speech(("AA", 0.5))]))
    np.testing.assert_array_equal(avatar.befores[0], np.repeat(avatar.rest[None], 8, axis=0))
    np.testing.assert_array_equal(avatar.befores[1][-3:], made[0].coefficients)
    assert len(made[2].coefficients) == REST_FRAMES
    assert not made[2].samples.any()
    assert made[2].coefficients[-1, 0] == 0


def test_a_model_hears_the_sound_on_the_clock_of_its_frames_over_the_cuts() -> None:
    avatar, rate = TinyAvatar(), 16_000
    samples = np.random.default_rng(0).uniform(-1, 1, 2 * rate).astype(np.float32)
    cuts = [0, 5_000, 16_130, 30_000]  # no frame begins there
    parts = [
        Speech(samples[a:b], rate, (Phone("AA", 0, (b - a) / rate),), ahead=samples[b : b + 1_600], recognised=bool(a))
        for a, b in pairwise(cuts)
    ]
    made = list(pieces(avatar, parts))
    assert list(avatar.recognised) == [False, True, True]
    for number, (sound, piece) in enumerate(zip(avatar.sounds, made, strict=False)):
        begin = round((piece.frame / FPS + sound.start) * rate)  # of what it hears, in all the samples
        assert np.array_equal(sound.samples, samples[begin : cuts[number + 1] + 1_600])
        assert begin == max(0, cuts[number] - rate // 2)


def test_speech_is_taken_one_by_one_and_stages_are_marked() -> None:
    marks: list[str] = []
    taken: list[int] = []

    def speeches():
        for n in range(3):
            taken.append(n)
            yield speech(("AA", 0.2))

    made = pieces(TinyAvatar(), speeches(), marks.append)
    assert taken == []
    next(made)
    assert taken == [0]
    assert marks == ["speech", "trajectory"]


def test_a_piece_shorter_than_a_frame_has_sound_but_no_mouth_of_its_own() -> None:
    made = list(pieces(TinyAvatar(), [speech(("AA", seconds), rate=24_000) for seconds in (0.05, 0.01, 0.05)]))
    assert [len(piece.coefficients) for piece in made] == [2, 0, 1, REST_FRAMES]
    assert len(made[1].samples) == 480


def test_nothing_makes_nothing() -> None:
    assert list(pieces(TinyAvatar(), [])) == []


def test_where_there_is_nothing_yet_there_is_no_piece() -> None:
    made = list(pieces(TinyAvatar(), [None, speech(("AA", 0.2)), None, None]))
    assert [piece is None for piece in made] == [True, False, True, True, False]
    assert made[4].sample == len(made[1].samples)


def test_phones_and_words_are_timed_from_the_utterances_start() -> None:
    first = replace(speech(("AA", 0.2), (SILENCE, 0.1)), words=(Word("Ah.", 0.0, 0.2),))
    second = replace(speech(("M", 0.2)), words=(Word("Mm", 0.05, 0.2),), marks=(Mark("m", 0.1),))
    one, two, rest = pieces(TinyAvatar(), [first, second])
    assert [phone.symbol for phone in (*one.phones, *two.phones, *rest.phones)] == ["AA", SILENCE, "M", SILENCE]
    ends = [phone.end for phone in (*one.phones, *two.phones, *rest.phones)]
    assert ends == pytest.approx(
        [0.2, 0.3, 0.5, (len(one.samples) + len(two.samples) + len(rest.samples)) / 48_000], abs=1e-4
    )
    assert (one.words, two.words[0].text, rest.words) == ((Word("Ah.", 0.0, 0.2),), "Mm", ())
    assert (one.marks, two.marks[0].name, two.marks[0].time) == ((), "m", pytest.approx(0.4, abs=1e-4))
    assert (two.words[0].start, two.words[0].end) == pytest.approx((0.35, 0.5), abs=1e-4)


def test_a_piece_cut_from_speech_moves_as_the_whole_does() -> None:
    """With what is around it, a piece has the frames that it has in the whole: nothing shows where it was cut."""
    avatar = load_avatar(Path(__file__).resolve().parents[2] / "avatars" / "mary")
    phones = [
        Phone(symbol, n * 0.09, (n + 1) * 0.09)
        for n, symbol in enumerate(["HH", "AH", "L", "OW", "M", "AA", "M", "AH", "B", "AA", "P", "IY"])
    ]
    duration = phones[-1].end
    samples = np.zeros(round(duration * 48_000), np.float32)
    (whole, _) = pieces(avatar, [Speech(samples, 48_000, tuple(phones))])
    scale = np.abs(np.diff(whole.coefficients, axis=0)).max()

    def cut(start: float, end: float, *, known: bool) -> Speech:
        around = tuple(Phone(p.symbol, p.start - start, p.end - start) for p in phones if p.start < end + 0.2)
        inside = [Phone(p.symbol, max(p.start, 0.0), min(p.end, end - start)) for p in around]
        inside = [p for p in inside if p.end > p.start]
        count = round((end - start) * 48_000)
        return Speech(samples[:count], 48_000, tuple(inside), around=around if known else ())

    def error(known: bool) -> float:
        edges = [*np.arange(0, duration, 0.2), duration]
        parts = [cut(start, end, known=known) for start, end in pairwise(edges)]
        rows = np.concatenate([piece.coefficients for piece in pieces(avatar, parts) if piece is not None])
        return float(np.abs(rows[: len(whole.coefficients)] - whole.coefficients).max() / scale)

    assert error(known=True) < 0.05
    assert error(known=False) > 0.2  # or this test shows nothing


def test_a_piece_says_which_mouth_it_follows() -> None:
    avatar = TinyAvatar()
    one, two, rest = pieces(avatar, [speech(("AA", 0.2)), speech(("AA", 0.2))])
    np.testing.assert_array_equal(one.follows, avatar.rest)
    np.testing.assert_array_equal(two.follows, one.coefficients[-1])
    np.testing.assert_array_equal(rest.follows, two.coefficients[-1])


@given(start=st.floats(-1, 1), speed=st.floats(-3, 3), frames=st.integers(2, 8))
def test_to_rest_never_goes_beyond_rest(start: float, speed: float, frames: int) -> None:
    rows = to_rest(TinyAvatar(), frames, np.array([[start - speed, 1], [start, 1]], np.float32))
    assert np.all(rows[:, 0] * np.sign(start) >= -1e-6)
    assert rows[-1, 0] == 0


@given(speed=st.floats(-0.3, 0.3), frames=st.integers(2, 8))
def test_to_rest_goes_on_as_it_moves_and_ends_at_rest_without_a_jerk(speed: float, frames: int) -> None:
    before = np.array([[1 - speed, 1], [1, 1]], np.float32)
    rows = to_rest(TinyAvatar(), frames, before)
    assert rows.shape == (frames, 2)
    assert rows.dtype == np.float32
    assert rows[-1].tolist() == [0, 1]
    t = np.arange(1, frames + 1) / frames  # the textbook's cubic Hermite spline, written out
    hermite = 2 * t**3 - 3 * t**2 + 1 + (t**3 - 2 * t**2 + t) * speed * frames
    np.testing.assert_allclose(rows[:, 0], hermite, atol=1e-5)
