from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine.pack import FPS
from app.engine.training.corpus import Corpus, Passage
from app.engine.training.stretches import DISSOLVE, LONGEST, WANTED, Stretch, choose_stretches, cuts, joined

MOST = round(LONGEST * FPS)


def moving(corpus: Corpus, takes: list[list[int]], seed: int = 0) -> Corpus:
    """A corpus of takes with passages of these lengths, whose head wanders at random and never looks alike twice."""
    random = np.random.default_rng(seed)
    total = sum(map(sum, takes))
    wander = np.cumsum(random.normal(0, 3, (total, 2)), 0)
    poses = np.tile(np.array([[1, 0, 0], [0, 1, 0]], float), (total, 1, 1))
    poses[:, :, 2] = wander
    parts, starts, at = [], [0], 0
    for number, lengths in enumerate(takes):
        first = at
        for length in lengths:
            parts.append(Passage(number, range(at, at + length), at - first))
            at += length
        starts.append(at)
    return replace(
        corpus, starts=np.array(starts, np.int64), poses=poses, good=np.ones(total, bool), rest=np.zeros(total, bool),
        passages=tuple(parts), takes=tuple(corpus.takes[0] for _ in takes),
        thumbs=random.integers(0, 256, (total, 24, 24), np.uint8),
    )  # fmt: skip


def alike(corpus: Corpus, left: int, entered: int) -> None:
    """Make what happens around frame `left` and around frame `entered` look and move alike."""
    for offset in range(-1, 2):
        corpus.poses[entered + offset] = corpus.poses[left + offset]
        corpus.thumbs[entered + offset] = corpus.thumbs[left + offset]


def joints(stretches: list[Stretch]) -> set[tuple[int, int]]:
    """(the frame that would come next, the frame that comes instead)."""
    return {
        (here.frames.stop, after.frames.start)
        for here, after in zip(stretches, stretches[1:] + stretches[:1], strict=True)
    }  # fmt: skip


def length(stretches: list[Stretch]) -> int:
    return sum(len(stretch.frames) for stretch in stretches)


@pytest.mark.parametrize("seed", range(4))
def test_the_joints_at_which_pictures_look_and_move_alike_are_found(corpus: Corpus, seed: int) -> None:
    made = moving(corpus, [[110, 110], [110, 110, 110]], seed)
    alike(made, 110 - 14, 330 + 19)  # from the first passage into the fourth
    alike(made, 440 - 20, 0 + 11)  # and back
    found = choose_stretches(made, most=MOST)
    assert joints(found) == {(96, 349), (420, 11)}
    assert length(found) == (96 - 11) + (420 - 349)


def test_alike_but_moving_the_other_way_is_no_good_joint(corpus: Corpus) -> None:
    made = moving(corpus, [[250]])
    still = np.tile(made.thumbs[0], (250, 1, 1))
    made = replace(made, thumbs=still)
    made.poses[:, :, 2] = 0
    made.poses[:, 0, 2] = 40 * np.sin(np.arange(250) / 7)  # the head turns to and fro
    (only,) = choose_stretches(made, most=240)
    ahead, instead = only.frames.stop, only.frames.start
    assert made.poses[instead, 0, 2] == pytest.approx(made.poses[ahead, 0, 2], abs=4)
    speed = np.gradient(made.poses[:, 0, 2])
    assert speed[instead] == pytest.approx(speed[ahead], abs=1.5)


@given(
    st.lists(st.lists(st.integers(50, 400), min_size=1, max_size=4), min_size=1, max_size=3),
    st.integers(90, 260), st.integers(0, 5),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_a_loop_is_long_enough_and_not_too_long(shared: Corpus, takes: list[list[int]], most: int, seed: int) -> None:
    made = moving(shared, takes, seed)
    found = choose_stretches(made, most=most)
    assert 0 < length(found) <= most
    to_and_fro = found[-1].frames.step < 0
    if to_and_fro:
        there, back = (stretch.frames for stretch in found)
        assert [*back] == [*there][-2:0:-1]
        assert any(there.start in p.frames and there.stop - 1 in p.frames for p in made.passages)
    for stretch in [] if to_and_fro else found:  # leaves where its passage does, not in the middle of a word
        (inside,) = [p.frames for p in made.passages if stretch.frames.start in p.frames]
        assert stretch.frames.stop - 1 in inside
        if len(inside) >= 2 * DISSOLVE + 50:
            end = min(inside.stop, inside.start + most)
            assert end - 24 <= stretch.frames.stop <= end - DISSOLVE
            assert inside.start + DISSOLVE <= stretch.frames.start <= inside.start + 24
    mixed = joined(found, made)
    assert len(mixed) == length(found)
    of_take = np.repeat(np.arange(len(takes)), np.diff(made.starts))
    for stretch, (begin, end) in zip(found, _places(found), strict=True):
        for place in range(begin, end):
            assert of_take[mixed[place][0][0]] == of_take[stretch.frames.start]
    for parts in mixed:
        assert sum(share for _, share in parts) == pytest.approx(1)
        assert all(0 < share <= 1 and 0 <= number < len(made.good) for number, share in parts)


@pytest.fixture(scope="session")
def shared(corpus: Corpus) -> Corpus:
    return corpus


def _places(stretches: list[Stretch]) -> list[tuple[int, int]]:
    ends = np.cumsum([len(stretch.frames) for stretch in stretches]).tolist()
    return list(zip([0, *ends[:-1]], ends, strict=True))


def test_a_loop_of_many_passages_is_about_as_long_as_wanted(corpus: Corpus) -> None:
    made = moving(corpus, [[80, 90, 100, 70, 120], [75, 95, 85]])
    made.poses[:, :, 2] /= 100
    made = replace(made, thumbs=made.thumbs // 100 + 100)
    assert WANTED * FPS - 40 <= length(choose_stretches(made, most=MOST)) <= MOST


def test_a_single_short_take_still_gives_a_loop(corpus: Corpus) -> None:
    for frames in (2, 3, 5, 9, 17, 30, 60):
        made = moving(corpus, [[frames]])
        found = choose_stretches(made, most=MOST)
        assert [number for stretch in found for number in stretch.frames] == [*range(frames), *range(frames - 2, 0, -1)]
        assert joined(found, made) == [[(number, 1.0)] for stretch in found for number in stretch.frames]


def shown(stretches: list[Stretch], corpus: Corpus) -> set[int]:
    return {number for parts in joined(stretches, corpus) for number, _ in parts}


@pytest.mark.parametrize("seed", range(6))
def test_broken_frames_are_never_shown(corpus: Corpus, seed: int) -> None:
    made = moving(corpus, [[150, 160], [170]], seed)
    random = np.random.default_rng(seed)
    made.good[random.choice(480, (0, 1, 5, 25, 100, 240)[seed], replace=False)] = False
    assert made.good[sorted(shown(choose_stretches(made, most=MOST), made))].all()


@pytest.mark.parametrize("every", [25, 5])
def test_a_slower_camera_whose_pictures_are_shown_twice_has_a_loop_too(corpus: Corpus, every: int) -> None:
    # 24 or 20 pictures a second: one a second, or every fifth, is shown again and nothing to learn from.
    made = moving(corpus, [[150, 160]])
    made.good[12::every] = False
    found = choose_stretches(made, most=MOST)
    assert length(found) >= 120
    mixed = joined(found, made)
    assert made.good[sorted(shown(found, made))].all()
    place = 0
    for stretch in found:
        for number in stretch.frames:  # the picture before stays on
            assert mixed[place][0][0] == (number if made.good[number] else number - 1)
            place += 1


def test_frames_before_a_break_and_of_another_take_are_not_mixed_in(corpus: Corpus) -> None:
    made = moving(corpus, [[100], [100]])
    made.good[58:60] = False
    stretches = [Stretch(range(103, 150)), Stretch(range(64, 90))]
    mixed = joined(stretches, made)
    assert [len(parts) for parts in mixed] == [*[1] * 43, *[2] * 4, *[1] * 23, *[2] * 3]
    assert [[number for number, _ in parts] for parts in mixed[43:47]] == [[146 + k, 60 + k] for k in range(4)]
    assert [[number for number, _ in parts] for parts in mixed[-3:]] == [[87 + k, 100 + k] for k in range(3)]


def test_one_stretch_dissolves_evenly_into_the_next(corpus: Corpus) -> None:
    made = moving(corpus, [[100], [100]])
    mixed = joined([Stretch(range(10, 60)), Stretch(range(120, 180))], made)
    assert len(mixed) == 110
    assert mixed[:42] == [[(number, 1.0)] for number in range(10, 52)]
    for step in range(DISSOLVE):
        (here, kept), (after, share) = mixed[42 + step]
        assert (here, after) == (52 + step, 112 + step)
        assert share == pytest.approx((step + 1) / 9)
        assert kept == pytest.approx(1 - (step + 1) / 9)
    assert mixed[50] == [(120, 1.0)]
    assert [number for number, _ in mixed[-1]] == [179, 9]


def test_dissolves_that_overlap_still_share_the_picture_out(corpus: Corpus) -> None:
    made = moving(corpus, [[300]])
    mixed = joined([Stretch(range(40, 60)), Stretch(range(100, 104)), Stretch(range(200, 240))], made)
    assert max(len(parts) for parts in mixed) == 3
    assert [sum(share for _, share in parts) for parts in mixed] == pytest.approx([1] * len(mixed))


def test_drawn_heads_are_joined_where_they_are(corpus: Corpus) -> None:
    found = choose_stretches(corpus, most=MOST)
    where: NDArray[np.float64] = corpus.poses[:, :, 2]
    for ahead, instead in joints(found):
        assert np.linalg.norm(where[ahead] - where[instead]) < 0.5
    assert corpus.good[sorted(shown(found, corpus))].all()


def test_a_loop_never_goes_across_a_cut_in_the_film(corpus: Corpus) -> None:
    """At the cut one picture is refused; after it the head is somewhere else."""
    made = moving(corpus, [[60]])
    good, poses = made.good.copy(), made.poses.copy()
    good[35] = False
    poses[35:, :, 2] += 0.2 * made.layout.side
    found = choose_stretches(replace(made, good=good, poses=poses), most=MOST)
    numbers = {number for stretch in found for number in stretch.frames}
    assert numbers == set(range(35))


def test_a_cut_is_seen_in_the_picture_where_the_head_stays(corpus: Corpus) -> None:
    made = moving(corpus, [[60]])
    slow = np.clip(100 + np.cumsum(np.random.default_rng(0).normal(0, 0.4, (60, 24, 24)), 0), 0, 255)
    slow[35:] += 6
    made = replace(made, thumbs=slow.astype(np.uint8), poses=np.tile(made.poses[:1], (60, 1, 1)))
    assert np.flatnonzero(cuts(made)).tolist() == [35]
    found = choose_stretches(made, most=MOST)
    assert {number for stretch in found for number in stretch.frames} == set(range(35))
