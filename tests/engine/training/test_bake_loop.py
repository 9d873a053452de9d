from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawn_recording import LOOP_SHIFTS, OPENING, crop_of, picture
from numpy.typing import NDArray

from app.engine.background import STILL, Background, Box, Compositor, Planes
from app.engine.frame import from_rgb, planes
from app.engine.modes import ModeMouth, Modes
from app.engine.training.bake_loop import (
    activity,
    bake,
    detail_layer,
    mouth_mask,
    pose_track,
    replaced_mask,
    robust_fit,
)
from app.engine.training.recording import Recording, flatten
from app.engine.training.train import Trained, learn
from app.errors import TrainingFailed

Float = NDArray[np.float32]


@pytest.fixture(scope="module")
def trained(recording: Recording) -> Trained:
    return learn(recording)


def recorded_rest(recording: Recording, trained: Trained) -> Float:
    return recording.frames[trained.rest_frames].mean(0, dtype=np.float64).astype(np.float32)


@pytest.fixture(scope="module")
def baked(recording: Recording, trained: Trained) -> tuple[Modes, Background]:
    return bake(recording, recording.frames, trained.modes, trained.rest, recorded_rest(recording, trained), ModeMouth)


def test_activity_is_how_much_each_pixel_changes() -> None:
    frames = np.full((40, 32 * 24 * 3 // 2), 100, np.uint8)
    luma = frames[:, : 32 * 24].reshape(40, 24, 32)
    luma[::2, 8:16, 10:22] = 120  # a standard deviation of 10
    active = activity(frames, 32, 24)
    assert active.shape == (24, 32)
    assert active[11, 16] == pytest.approx(9.8, abs=0.5)
    assert active[0, 0] < 0.01


def test_the_mask_is_one_where_anything_moves_and_falls_to_zero_at_the_edge() -> None:
    active = np.zeros((48, 64), np.float32)
    active[20:30, 25:40] = 5
    mask = mouth_mask(active)
    assert mask.dtype == np.float32
    assert (mask[22:28, 28:37] > 0.95).all()
    assert mask.min() >= 0
    assert mask.max() <= 1
    assert mask[:6].max() < 0.01
    everywhere = mouth_mask(np.full((48, 64), 5, np.float32))
    assert (everywhere[[0, -1]] == 0).all()
    assert (everywhere[:, [0, -1]] == 0).all()
    assert (everywhere[12:-12, 12:-12] > 0.99).all()
    assert np.abs(np.diff(everywhere, axis=1)).max() < 0.2


def test_calm_skin_keeps_the_loops_pixels_and_lips_do_not() -> None:
    active = np.zeros((48, 64), np.float32)
    active[:, :20], active[:, 40:] = 0.3, 8.0
    share = replaced_mask(active)
    assert (share[:, :25] < 1e-3).all()
    assert (share[:, 48:] > 0.999).all()


def test_the_pose_track_is_the_loops_map_on_the_regions_grid(recording: Recording) -> None:
    region, pose = pose_track(recording)
    assert region == Box(0, 0, 96, 80)  # 16 pixels around the crop are the whole frame
    assert pose.shape == (5, 21, 25, 2)
    assert pose.dtype == np.float32
    for frame, shift in zip(pose, (*LOOP_SHIFTS, (0, 0)), strict=True):
        np.testing.assert_allclose(frame, np.broadcast_to(shift, frame.shape), atol=1e-5)
    smaller, pose = pose_track(recording, margin=6)
    assert smaller == Box(10, 10, 76, 60)
    assert pose.shape == (5, 16, 20, 2)


def mapped(recording: Recording, folder: Path, warp: Float, step: int = 4) -> tuple[Box, Float]:
    (folder / "idle").mkdir()
    np.savez(folder / "idle" / "warp.npz", warp=warp.astype(np.float32), step=step)
    return pose_track(replace(recording, folder=folder), margin=6)


def test_a_turning_head_is_read_on_another_grid_than_the_maps(recording: Recording, tmp_path: Path) -> None:
    y, x = np.mgrid[:80:5, :96:5].astype(np.float64)  # every fifth pixel
    turning = np.stack([2 + x / 16 - x * y / 800, y / 8 + (x - 48) ** 2 / 500], -1)[None]
    region, pose = mapped(recording, tmp_path, turning, step=5)
    rows, columns = np.mgrid[: pose.shape[1], : pose.shape[2]] * 4.0
    x, y = columns + region.x, rows + region.y
    np.testing.assert_allclose(pose[0, ..., 0], 2 + x / 16 - x * y / 800, atol=1e-3)
    np.testing.assert_allclose(pose[0, ..., 1], y / 8 + (x - 48) ** 2 / 500, atol=1e-3)


def test_hair_and_neck_beside_the_face_do_not_bend_its_motion(recording: Recording, tmp_path: Path) -> None:
    y, x = np.mgrid[:80:4, :96:4].astype(np.float64)
    face = np.stack([1 + x / 50, -0.5 + y / 40], -1)
    beside = (x < 26) | (y > 58)  # a seventh of the face's ellipse
    torn = np.where(beside[..., None], face + np.array([7.0, -5.0]), face)
    region, pose = mapped(recording, tmp_path, torn[None])
    rows, columns = np.mgrid[: pose.shape[1], : pose.shape[2]] * 4.0
    expected = np.stack([1 + (columns + region.x) / 50, -0.5 + (rows + region.y) / 40], -1)
    assert np.abs(pose[0] - expected).max() < 0.15
    assert np.abs(np.diff(pose[0], axis=1)).max() < 0.2, "nothing is torn"


def test_the_fit_is_least_squares_unless_points_are_far_off() -> None:
    random = np.random.default_rng(0)
    terms = random.standard_normal((400, 6))
    truth = random.standard_normal((6, 2))
    noisy = terms @ truth + 0.02 * random.standard_normal((400, 2))
    expected = np.linalg.lstsq(terms, noisy, rcond=None)[0]
    np.testing.assert_allclose(robust_fit(terms, noisy), expected, atol=1e-9)
    noisy[:80] += (5, -8)
    assert np.abs(robust_fit(terms, noisy) - truth).max() < 0.03
    assert np.abs(np.linalg.lstsq(terms, noisy, rcond=None)[0] - truth).max() > 0.3


def test_detail_is_what_the_clean_picture_has_more_and_nothing_inside_the_mouth(trained: Trained) -> None:
    modes = trained.modes
    size = modes.width * modes.height
    nothing = np.zeros(size * 3 // 2, np.float32)
    assert (detail_layer(modes, trained.rest, nothing, nothing) == 0).all()
    brighter = detail_layer(modes, trained.rest, nothing + 4, nothing)
    luma = brighter[:size].reshape(modes.height, modes.width)
    assert luma[4:-4, [6, -7]] == pytest.approx(4, abs=0.05)  # skin
    inside = modes.layer == 0
    y, x = (int(place) for place in np.argwhere(inside).mean(0))
    assert inside[y, x]
    assert luma[2 * y, 2 * x] == pytest.approx(0, abs=0.05)
    assert brighter[size:].max() <= 4.05


def test_every_baked_frame_shows_the_models_mouth_at_rest(
    recording: Recording, trained: Trained, baked: tuple[Modes, Background]
) -> None:
    modes, background = baked
    assert background.frames == len(LOOP_SHIFTS)
    assert background.crop == recording.crop
    assert (background.mask[[0, -1]] == 0).all()
    compositor = Compositor(background, ModeMouth(modes, background), trained.rest)
    out = np.empty_like(background.pictures[0])
    for frame in (*range(4), STILL):
        compositor.render(trained.rest, frame, out)
        np.testing.assert_array_equal(out, background.pictures[background.index(frame)])
    mouth = ModeMouth(modes, background)
    drawn = Planes.empty(background.region.width, background.region.height)
    active = activity(recording.frames, 64, 48)
    for index in range(4):
        mouth.draw(trained.rest, index, drawn)
        lips = replace(background, mask=replaced_mask(active) * (background.mask > 0)).posed_mask(index)[0] > 0.999
        assert lips.sum() > 100
        luma = background.region.luma(background.pictures[index])
        assert np.abs(luma[lips] - drawn.luma[lips]).max() < 0.51


def test_the_baked_loop_looks_like_the_recorded_one_and_is_the_same_far_from_the_mouth(
    baked: tuple[Modes, Background],
) -> None:
    for shown, shift in zip(baked[1].pictures, LOOP_SHIFTS, strict=False):
        original = from_rgb(picture(OPENING["SIL"], shift))
        luma, expected = planes(shown)[0].astype(float), planes(original)[0].astype(float)
        assert np.abs(luma - expected).mean() < 1
        assert 10 * np.log10(255**2 / ((luma - expected) ** 2).mean()) > 32
        np.testing.assert_array_equal(luma[:12], expected[:12])


def test_the_still_is_the_recordings_own_rest(
    recording: Recording, trained: Trained, baked: tuple[Modes, Background]
) -> None:
    still = crop_of(planes(baked[1].pictures[-1])[0][..., None])[..., 0].astype(float)
    rest = recorded_rest(recording, trained)[: 64 * 48].reshape(48, 64)
    middle = np.s_[18:30, 20:44]
    assert np.abs(still - rest)[middle].max() <= 1
    outside = planes(from_rgb(recording.still()))[0]
    np.testing.assert_array_equal(planes(baked[1].pictures[-1])[0][:14], outside[:14])


def test_a_loop_of_another_length_than_its_track_is_refused(
    recording: Recording, trained: Trained, drawn: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(drawn, tmp_path / "copy"))
    with np.load(folder / "idle" / "warp.npz") as stored:
        np.savez(folder / "idle" / "warp.npz", warp=stored["warp"][:-1], step=4)
    broken = replace(recording, folder=folder)
    with pytest.raises(TrainingFailed, match="the loop has 4 frames, its pose track 3"):
        bake(broken, recording.frames, trained.modes, trained.rest, recorded_rest(recording, trained), ModeMouth)


def test_progress_is_told(recording: Recording, trained: Trained) -> None:
    told: list[float] = []
    bake(
        recording,
        recording.frames,
        trained.modes,
        trained.rest,
        recorded_rest(recording, trained),
        ModeMouth,
        told.append,
    )
    assert told == [0, 0.25, 0.5, 0.75]


def test_clean_and_recorded_pictures_are_measured_in_the_same_planes(recording: Recording) -> None:
    clean = flatten(crop_of(recording.still())).astype(float)
    assert np.abs(clean - recording.frames[:5].mean(0)).mean() < 1
