from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
from filmed import IDLE, MOVING_HEAD, Rgb, idle, luma_of, moving_head, places, similarity, warped
from numpy.typing import NDArray

from app.engine.training.face_detector import RIVAL, FaceBox, find_faces

EYES = ("eye_l_in", "eye_l_out", "eye_r_in", "eye_r_out")


def beside(*pictures: Rgb) -> NDArray[np.uint8]:
    return np.hstack([luma_of(rgb) for rgb in pictures])


@pytest.mark.parametrize(("folder", "pictures"), [(IDLE, idle), (MOVING_HEAD, moving_head)])
def test_one_face_with_its_eyes_and_mouth_where_they_should_be(
    folder: Path, pictures: Callable[[], tuple[Rgb, ...]]
) -> None:
    eyes = places(folder, EYES, "landmarks").mean(1)
    mouth = places(folder, ["lip_mid"]).mean(1)
    for number in range(0, len(pictures()), 8):
        (box,) = find_faces(luma_of(pictures()[number]))
        eyes_at, mouth_at = ((at - (box.x, box.y)) / box.side for at in (eyes[number], mouth[number]))
        assert np.abs(eyes_at - (0.51, 0.41)).max() < 0.09, number
        assert np.abs(mouth_at - (0.51, 0.80)).max() < 0.12, number


def test_numbers_are_pythons_own() -> None:
    (box,) = find_faces(luma_of(idle()[0]))
    assert [type(number) for number in astuple(box)] == [float] * 3


@pytest.mark.parametrize("size", [(160, 160), (360, 360), (720, 720), (1000, 600)])
def test_the_box_grows_with_the_picture(size: tuple[int, int]) -> None:
    scale = min(size) / 512
    shown = warped(idle()[0], similarity(scale=scale), size)
    (small,), (usual,) = find_faces(luma_of(shown)), find_faces(luma_of(idle()[0]))
    np.testing.assert_allclose(np.array(astuple(small)) / scale, astuple(usual), atol=0.06 * usual.side)


def test_none_where_there_is_none() -> None:
    random = np.random.default_rng(0)
    assert find_faces(np.full((240, 320), 128, np.uint8)) == []
    assert find_faces(np.zeros((240, 320), np.uint8)) == []
    for _ in range(3):
        assert find_faces(random.integers(0, 256, (240, 320), np.uint8)) == []


def test_two_faces_beside_each_other() -> None:
    found = find_faces(beside(idle()[0], idle()[60]))
    assert len(found) == 2
    assert {box.x > 512 for box in found} == {True, False}


def test_the_largest_is_first_and_a_much_smaller_one_is_left_out() -> None:
    whole = idle()[0]
    for scale in (0.7, 0.3):
        small = warped(whole, similarity(scale=scale), (256, 512))
        found = find_faces(beside(small, whole))
        assert found[0].x > 256
        assert len(found) == (2 if scale > RIVAL else 1)


def test_faces_smaller_than_a_seventh_are_not_looked_for() -> None:
    picture = luma_of(warped(idle()[0], similarity(200, 200, scale=0.2), (512, 512)))
    assert find_faces(picture) == []


def test_the_picture_is_left_as_it_is() -> None:
    picture = luma_of(idle()[0])
    picture.flags.writeable = False
    assert isinstance(find_faces(picture)[0], FaceBox)
    assert find_faces(picture[:, ::-1])  # a view, not contiguous
