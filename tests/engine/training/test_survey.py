from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from filmed import FPS, Array, Rgb, idle, luma_of, silence, similarity, speaking, spoken, vowel, warped, write_film
from numpy.typing import NDArray

from app.engine.background import Box
from app.engine.frame import from_rgb, planes
from app.engine.training.face_detector import find_faces
from app.engine.training.face_tracker import template_of
from app.engine.training.layout import Layout, lay_out
from app.engine.training.survey import FASTEST, LOOK_AGAIN, Follower, Survey, cut, smoothed, survey
from app.engine.training.take import Take
from app.errors import TrainingFailed
from app.speech import Phone

COUNT = 60
Film = Callable[..., Take]


@pytest.fixture(scope="module")
def layout(tmp_path_factory: pytest.TempPathFactory) -> Layout:
    path = write_film(tmp_path_factory.mktemp("films") / "mary.mp4", speaking()[:COUNT])
    return lay_out([Take("mary", path, spoken(COUNT))])[0]


@pytest.fixture
def film(tmp_path: Path) -> Film:
    def write(pictures: Sequence[Rgb], phones: tuple[Phone, ...] | None = None, name: str = "mary") -> Take:
        path = write_film(tmp_path / f"{name}.mp4", pictures, options={"crf": "0"})
        return Take(name, path, phones or vowel(len(pictures)))

    return write


def swaying(count: int = COUNT) -> tuple[list[Rgb], Array]:
    """Mary speaks and moves her head in a known way: pictures and (count, 2, 3) poses."""
    time = np.arange(count) / FPS
    x, y, turn = 9 * np.sin(2.1 * time), 5 * np.sin(3.3 * time), 2 * np.sin(1.7 * time)
    scale = 1 + 0.02 * np.sin(2.7 * time)
    poses = np.stack([similarity(*each, (160, 150)) for each in zip(x, y, turn, scale, strict=True)])
    return [warped(rgb, pose) for rgb, pose in zip(speaking(), poses, strict=False)], poses


def broken(seen: Survey) -> dict[int, str]:
    return {refusal.frame: refusal.reason for refusal in seen.refused if refusal.frame is not None}


# --- a good take ------------------------------------------------------------------------------------------------------


def test_poses_are_those_of_the_head(layout: Layout, film: Film) -> None:
    pictures, poses = swaying()
    seen = survey(film(pictures, spoken(COUNT)), layout)
    assert seen.frames == COUNT
    assert seen.good.all()
    assert seen.refused == ()
    face = np.array([[110, 200, 160], [120, 120, 205], [1, 1, 1]])
    error = np.linalg.norm(seen.poses @ face - poses @ face, axis=1)
    assert error[3:-3].max() < 0.6
    assert np.sqrt((error[3:-3] ** 2).mean()) < 0.25


def test_the_mouth_at_rest_is_the_mean_of_its_stabilised_pictures(layout: Layout, film: Film) -> None:
    pictures, _ = swaying(40)
    seen = survey(film(pictures, silence(40)), layout)
    assert seen.rested.tolist() == [40]
    crop, still = layout.crop, from_rgb(speaking()[0])
    expected = cut(still, np.eye(3)[:2], crop)
    size = crop.width * crop.height
    assert np.abs(seen.rest[0][:size].astype(float) - expected[:size]).mean() < 4
    nobody_rests = survey(film(pictures, (Phone("AA", 0, 1.6),), "speaks"), layout)
    assert nobody_rests.rested.tolist() == [0]


def test_a_take_in_which_nothing_is_said_may_stand_still(layout: Layout, film: Film) -> None:
    seen = survey(film([speaking()[0]] * 30, silence(30)), layout)
    assert seen.good.all()


# --- what is refused --------------------------------------------------------------------------------------------------


def test_grey_and_black_pictures(layout: Layout, film: Film) -> None:
    pictures = list(speaking()[:COUNT])
    for number in (20, 21, 22):
        pictures[number] = np.full((320, 320, 3), 120, np.uint8)
    pictures[40] = np.zeros((320, 320, 3), np.uint8)
    pictures[50] = np.rint(110 + 0.05 * (pictures[50].astype(float) - 110)).astype(np.uint8)  # as seen through fog
    seen = survey(film(pictures), layout)
    assert set(broken(seen)) == {20, 21, 22, 40, 50}
    assert all("grey" in reason for reason in broken(seen).values())
    assert np.abs(seen.poses - np.eye(3)[:2]).max() < 1


def test_a_frozen_picture_while_somebody_speaks(layout: Layout, film: Film) -> None:
    pictures = list(speaking()[:COUNT])
    pictures[30:36] = [pictures[29]] * 6
    seen = survey(film(pictures), layout)
    assert set(broken(seen)) == set(range(30, 36))
    assert set(broken(seen).values()) == {"identical with the picture before"}
    assert seen.good.sum() == COUNT - 6


def test_pictures_that_the_camera_left_out(layout: Layout, tmp_path: Path) -> None:
    kept = [number for number in range(COUNT) if number not in (25, 26, 27)]
    path = write_film(tmp_path / "mary.mkv", [speaking()[n] for n in kept], times=[n / FPS for n in kept])
    seen = survey(Take("mary", path, vowel(COUNT)), layout)
    assert seen.frames == COUNT
    assert broken(seen) == dict.fromkeys((25, 26, 27), "the picture before it was shown again")


@pytest.mark.parametrize("pixels", [15, 25, 60])
def test_a_head_that_jumps(layout: Layout, film: Film, pixels: int) -> None:
    """As where two recordings were joined. A jump is no motion: the poses at its sides stay what they were."""
    assert pixels > FASTEST * layout.side
    pictures = [warped(rgb, similarity(0 if number < 30 else pixels)) for number, rgb in enumerate(speaking()[:COUNT])]
    seen = survey(film(pictures), layout)
    assert 30 in broken(seen)
    assert len(broken(seen)) < LOOK_AGAIN + 5
    for number in np.flatnonzero(seen.good):
        expected = 0 if number < 30 else pixels
        assert abs((seen.poses[number] @ [160, 150, 1])[0] - 160 - expected) < 0.7, number


def test_a_fast_but_possible_move_is_kept(layout: Layout, film: Film) -> None:
    far = 0.8 * FASTEST * layout.side
    x = np.concatenate([np.zeros(20), np.arange(1, 6) * far, np.full(35, 5 * far)]) - 20
    seen = survey(film([warped(rgb, similarity(at)) for rgb, at in zip(speaking(), x, strict=False)]), layout)
    assert seen.good.all()


def hand(rgb: Rgb, x: int = 90, y: int = 90) -> Rgb:
    """A fist, as large as half the face."""
    shown = rgb.copy()
    cv2.ellipse(shown, (x + 55, y + 45), (58, 46), 10, 0, 360, (205, 160, 140), -1)
    for finger in range(4):
        cv2.line(shown, (x + 20 + 24 * finger, y + 10), (x + 16 + 24 * finger, y + 80), (150, 105, 90), 3)
    return shown


def test_a_hand_before_the_face(layout: Layout, film: Film) -> None:
    pictures = list(speaking()[:100])
    pictures[40:46] = [hand(rgb) for rgb in pictures[40:46]]
    seen = survey(film(pictures), layout)
    assert set(range(40, 46)) <= set(broken(seen))
    assert max(broken(seen)) <= 46 + LOOK_AGAIN  # found again
    reasons = {reason.partition(" (")[0] for reason in broken(seen).values()}
    assert reasons <= {"the face was lost", "no face found", "eyes and nose do not look like those of the others"}
    assert np.abs(seen.poses[seen.good] - np.eye(3)[:2]).max() < 1.5


def test_a_face_that_leaves_and_comes_back_elsewhere(layout: Layout, film: Film) -> None:
    nobody = [np.full((320, 320, 3), 90, np.uint8)] * 10
    textured = [np.ascontiguousarray(rgb[::-1]) for rgb in speaking()[:10]]
    later = [warped(rgb, similarity(30, -20, 3)) for rgb in speaking()[40:100]]
    for gone in (nobody, textured):
        seen = survey(film([*speaking()[:40], *gone, *later]), layout)
        assert set(range(40, 50)) <= set(broken(seen))
        assert seen.good[50 + LOOK_AGAIN + 1 :].all()
        place = seen.poses[-1] @ [160, 150, 1]
        assert np.linalg.norm(place - similarity(30, -20, 3) @ [160, 150, 1]) < 1


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        ([np.full((320, 320, 3), 90, np.uint8)] * 20, "mary: no face found"),
        ([np.hstack([rgb, rgb]) for rgb in idle()[:20]], "mary: 2 faces"),
        ([*speaking()[:20], *[np.full((320, 320, 3), 90, np.uint8)] * 30], "mary: 30 of 50 pictures are .* most: grey"),
        ([speaking()[0], *[speaking()[1]] * 40], "mary: [0-9]+ of 41 pictures are broken, most: identical"),
    ],
    ids=["nobody", "two", "mostly grey", "frozen"],
)  # fmt: skip
def test_a_take_that_is_of_no_use(layout: Layout, film: Film, pictures: list[Rgb], message: str) -> None:
    with pytest.raises(TrainingFailed, match=message):
        survey(film(pictures, vowel(len(pictures))), layout)


def test_a_film_that_is_shorter_or_longer_than_its_phones(layout: Layout, film: Film) -> None:
    for spoken_frames in (20, 200):
        seen = survey(film(speaking()[:40], spoken(spoken_frames)), layout)
        assert seen.frames == 40
        assert seen.good.all()


# --- following, smoothing, cutting ------------------------------------------------------------------------------------


def test_a_follower_finds_a_face_again() -> None:
    luma = luma_of(idle()[0])
    follower = Follower(template_of(luma, find_faces(luma)[0]), "mary")
    for rgb in idle()[:15]:
        assert follower.follow(luma_of(rgb)) is not None
    noise = np.random.default_rng(0).integers(0, 256, luma.shape, np.uint8)
    assert follower.follow(noise) is None
    assert follower.problem == "the face was lost"
    answers = [follower.follow(luma_of(rgb)) for rgb in idle()[16 : 16 + LOOK_AGAIN + 2]]
    assert answers[-1] is not None
    assert follower.problem == ""
    assert follower.follow(np.zeros_like(luma)) is None
    assert "grey" in follower.problem
    assert follower.follow(luma) is not None  # a black picture is no reason to look elsewhere


def test_smoothing_keeps_steady_motion_and_fills_gaps() -> None:
    line: list[Array | None] = [similarity(2.0 * n, -n) for n in range(30)]
    whole = smoothed(list(line))
    np.testing.assert_allclose(whole[5:-5], np.stack([pose for pose in line[5:-5] if pose is not None]), atol=1e-6)
    gaps = [None if number in (0, 10, 11, 29) else pose for number, pose in enumerate(line)]
    np.testing.assert_allclose(smoothed(gaps)[5:-5], whole[5:-5], atol=1e-6)
    assert smoothed(gaps).shape == (30, 2, 3)
    step: list[Array | None] = [similarity(0 if number < 10 else 50) for number in range(20)]
    np.testing.assert_allclose(smoothed(step, [10]), np.stack([pose for pose in step if pose is not None]))
    random = np.random.default_rng(0)
    noisy = [similarity(*random.normal(0, 0.3, 2)) for _ in range(400)]
    assert smoothed(list(noisy))[:, :, 2].std() < 0.6 * np.stack(noisy)[:, :, 2].std()


def waves(size: int, pose: Array) -> NDArray[np.uint8]:
    """A smooth picture, planes; each plane drawn where it is sited, at pose^-1 of its place."""
    back = np.linalg.inv(np.vstack([pose, [0, 0, 1]]))

    def drawn(step: int, lower: float, phase: float) -> NDArray[np.uint8]:
        y, x = np.mgrid[: size // step, : size // step].astype(np.float64)
        x, y = x * step, y * step + lower
        u, v = back[0, 0] * x + back[0, 1] * y + back[0, 2], back[1, 0] * x + back[1, 1] * y + back[1, 2]
        return np.rint(128 + 60 * np.sin(u / 9 + phase) * np.cos(v / 11)).astype(np.uint8)

    return np.concatenate([drawn(1, 0, 0).ravel(), drawn(2, 0.5, 1).ravel(), drawn(2, 0.5, 2).ravel()]).reshape(
        -1, size
    )


def test_a_crop_is_cut_at_the_pose_every_plane_at_its_site() -> None:
    crop = Box(60, 80, 90, 64)
    straight = cut(waves(240, np.eye(3)[:2]), np.eye(3)[:2], crop)
    luma, blue, red = planes(waves(240, np.eye(3)[:2]))
    rows, columns = slice(80, 144), slice(60, 150)
    expected = [luma[rows, columns], blue[40:72, 30:75], red[40:72, 30:75]]
    np.testing.assert_array_equal(straight, np.concatenate([plane.ravel() for plane in expected]))
    for pose in (similarity(3.3, -2.7, 4, 1.03, (100, 100)), similarity(-8, 5, -3, 0.95, (120, 90))):
        difference = np.abs(cut(waves(240, pose), pose, crop).astype(float) - straight)
        assert difference.max() <= 3
        assert difference.mean() < 0.5
    shift = similarity(1.5, 0.5, 1, 1.01)
    to_picture = np.vstack([similarity(crop.x, crop.y), [0, 0, 1]]) @ np.vstack([shift, [0, 0, 1]])
    own = (to_picture @ np.linalg.inv(np.vstack([similarity(crop.x, crop.y), [0, 0, 1]])))[:2]
    difference = np.abs(cut(waves(240, own), np.eye(3)[:2], crop, shift=shift).astype(float) - straight)
    assert difference.max() <= 3


def test_a_much_larger_face_is_cut_without_aliases() -> None:
    random = np.random.default_rng(0)
    noise = random.integers(0, 256, (600, 400), np.uint8)  # nothing of it survives being made three times smaller
    small = cut(noise, similarity(scale=3), Box(20, 20, 90, 80))
    assert small[: 90 * 80].std() < 0.35 * noise.std()
