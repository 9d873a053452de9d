from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.avatar import Avatar
from app.engine.background import GRID, STILL, Background, Box, Compositor, Placement, Planes, chroma_map
from app.engine.frame import empty, planes
from app.engine.modes import ModeMouth, Modes
from app.engine.warp import pixel_grid, sample

Float = NDArray[np.float32]
REST = np.array([0.3, -0.2, 1, -1, 0.5], np.float32)
TALKING = np.array([2, 1, -8, 6, 9], np.float32)


@pytest.fixture
def compositor(modes: Modes, background: Background) -> Compositor:
    return Compositor(background, ModeMouth(modes, background), REST)


def rendered(
    compositor: Compositor | Avatar, coefficients: Float | None, loop_frame: int, like: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    out = np.full_like(like, 77)
    compositor.render(coefficients, loop_frame, out)
    return out


def test_boxes_are_views_of_all_planes() -> None:
    picture = empty(16, 12)
    picture[:] = 0
    box = Box(4, 2, 6, 8)
    box.luma(picture)[:] = 9
    for plane in box.chroma(picture):
        plane[:] = 7
    luma, blue, red = planes(picture)
    assert (luma[2:10, 4:10] == 9).all()
    assert luma.sum() == 9 * 48
    for plane in (blue, red):
        assert (plane[1:5, 2:5] == 7).all()
        assert plane.sum() == 7 * 12


def test_planes_are_made_for_a_region() -> None:
    made = Planes.empty(10, 6)
    assert [plane.shape for plane in made.each()] == [(6, 10), (3, 5), (3, 5)]
    assert made.each()[0] is made.luma


def test_the_loop_counts_on_for_ever_and_the_still_stands_apart(background: Background) -> None:
    assert background.frames == 4
    assert [background.index(frame) for frame in (0, 3, 4, 4 * 25 * 3600 + 2, STILL)] == [0, 3, 0, 2, 4]


def test_poses_shift_the_region_to_the_crop(background: Background) -> None:
    grid = pixel_grid(background.region.width, background.region.height)
    for index, shift in enumerate([(0, 0), (3, -1), (-0.5, 1.25), (2.3, 0.7), (0, 0)]):
        expected = (
            grid + np.array(shift) + (background.region.x - background.crop.x, background.region.y - background.crop.y)
        )
        np.testing.assert_allclose(background.backward(index), expected, atol=1e-5)


def test_the_forward_pose_is_the_inverse_of_the_backward_one(background: Background) -> None:
    grid = pixel_grid(background.region.width // GRID + 1, background.region.height // GRID + 1)
    bent = replace(background, pose=(background.pose + 1.5 * np.sin(grid / 3)).astype(np.float32))
    assert inversion_error(bent)[:, 2:-2, 2:-2].max() < 0.03


def test_marys_pose_is_inverted_to_a_fraction_of_a_pixel(mary: Avatar) -> None:
    assert inversion_error(mary.pack.background).max() < 0.05


def inversion_error(background: Background) -> Float:
    """(n, h, w) how far points of the crop come to lie from themselves, there and back, in every seventh frame."""
    points = pixel_grid(background.crop.width, background.crop.height)
    back = [
        sample(background.backward(index), background.forward(index, points), smooth=False)
        for index in range(0, len(background.pictures), 7 if background.frames > 10 else 1)
    ]
    return np.abs(np.stack(back) - points).max(-1)


def test_placements_hold_every_pose_for_the_vertices_of_a_mesh(background: Background) -> None:
    placement = Placement(background, 2)
    assert placement.vertices.shape == (10, 12, 2)
    assert placement.shift.shape == (5, 10, 12, 2)
    # Crop point p is shown at p - shift of the pose - origin, 8 pixels into the region.
    for index, shift in enumerate([(0, 0), (3, -1), (-0.5, 1.25), (2.3, 0.7), (0, 0)]):
        np.testing.assert_allclose(placement.shift[index], np.broadcast_to(8 - np.array(shift), (10, 12, 2)), atol=1e-4)


def test_masks_follow_the_pose_and_the_chroma_mask_is_the_mean_of_two_by_two(background: Background) -> None:
    for index, (x, y) in enumerate([(0, 0), (3, -1)]):
        luma, _ = background.posed_mask(index)
        expected = np.zeros_like(luma)
        expected[8 - y : 28 - y, 8 - x : 32 - x] = background.mask
        np.testing.assert_allclose(luma, expected, atol=1e-6)
    for index in range(5):
        luma, chroma = background.posed_mask(index)
        blocks = luma.reshape(chroma.shape[0], 2, chroma.shape[1], 2).mean((1, 3))
        np.testing.assert_allclose(chroma, blocks, atol=1e-6)
    halfway, _ = background.posed_mask(2)  # (-0.5, 1.25): weights 1/2, 1/2 across, 3/4, 1/4 down
    wide = np.pad(background.mask, 12)
    mean = (wide[:, 1:] + wide[:, :-1]) / 2
    mean = 0.75 * mean[:-1] + 0.25 * mean[1:]
    np.testing.assert_allclose(halfway, mean[5 : 5 + 36, 3 : 3 + 40], atol=1e-5)


def test_without_a_mouth_the_loop_is_shown(compositor: Compositor, background: Background) -> None:
    for frame in (*range(9), STILL):
        expected = background.pictures[background.index(frame)]
        np.testing.assert_array_equal(rendered(compositor, None, frame, expected), expected)


def test_at_rest_every_frame_is_the_loop_to_the_pixel(compositor: Compositor, background: Background) -> None:
    for frame in (*range(9), STILL):
        expected = background.pictures[background.index(frame)]
        np.testing.assert_array_equal(rendered(compositor, REST, frame, expected), expected)


def test_a_talking_frame_is_loop_minus_masked_rest_plus_masked_mouth(
    compositor: Compositor, background: Background, modes: Modes
) -> None:
    mouth = ModeMouth(modes, background)
    region = background.region
    for index in range(5):
        rest, now = (Planes.empty(region.width, region.height) for _ in range(2))
        mouth.draw(REST, index, rest)
        mouth.draw(TALKING, index, now)
        mask, half = background.posed_mask(index)
        loop = background.pictures[index]
        out = rendered(compositor, TALKING, index if index < 4 else STILL, loop)
        parts = zip(
            (region.luma(out), *region.chroma(out)), (region.luma(loop), *region.chroma(loop)), rest.each(), now.each(),
            (mask, half, half), strict=True,
        )  # fmt: skip
        for shown, before, at_rest, talking, weight in parts:
            exact = before - weight * at_rest + weight * talking
            # One rounding to a level, and a mask of 255 steps times what the mouth differs by.
            allowed = 0.52 + np.abs(talking - at_rest) / 510 + 0.01
            assert (np.abs(shown - np.clip(exact, 0, 255)) <= allowed).all()
        assert (out != loop).any()


def test_nothing_changes_where_the_mask_is_zero(compositor: Compositor, background: Background) -> None:
    for index in range(4):
        loop = background.pictures[index]
        changed = [
            a != b for a, b in zip(planes(rendered(compositor, TALKING, index, loop)), planes(loop), strict=True)
        ]
        mask, half = background.posed_mask(index)
        box = background.region
        for plane, (where, weight) in enumerate(zip(changed, (mask, half, half), strict=True)):
            scale = 1 if plane == 0 else 2
            y, x = box.y // scale, box.x // scale
            inside = where[y : y + weight.shape[0], x : x + weight.shape[1]]
            assert where.sum() == inside.sum(), "outside the region"
            assert not inside[weight == 0].any()


def test_mary_at_rest_is_her_loop_to_the_pixel_in_every_frame(mary: Avatar) -> None:
    pictures = mary.pack.background.pictures
    for frame in (*range(mary.manifest.loop_frames), STILL):
        shown = rendered(mary, mary.rest, frame, pictures[frame])
        np.testing.assert_array_equal(shown, pictures[frame], err_msg=str(frame))


def test_mary_talks_only_inside_her_region(mary: Avatar, spoken: Float) -> None:
    box = mary.pack.background.region
    for frame in (14, 30, 50):
        loop = mary.pack.background.pictures[frame]
        out = rendered(mary, spoken[frame], frame, loop)
        assert (out != loop).any()
        for view in (box.luma(out), *box.chroma(out)):
            view[...] = 0
        blank = loop.copy()
        for view in (box.luma(blank), *box.chroma(blank)):
            view[...] = 0
        np.testing.assert_array_equal(out, blank)


def test_four_threads_render_what_one_does(mary: Avatar, spoken: Float) -> None:
    like = mary.pack.background.pictures[0]
    frames = list(range(0, 72, 3))
    alone = [rendered(mary, spoken[frame], frame, like) for frame in frames]
    with ThreadPoolExecutor(4) as threads:
        jobs = [threads.submit(rendered, mary, spoken[frame], frame, like) for _ in range(3) for frame in frames]
        for job, expected in zip(jobs, alone * 3, strict=True):
            np.testing.assert_array_equal(job.result(), expected)


def test_chroma_maps_have_half_the_size_and_lie_between_rows() -> None:
    half = chroma_map(pixel_grid(12, 8).copy())
    assert half.shape == (4, 6, 2)
    np.testing.assert_allclose(half, pixel_grid(6, 4), atol=1e-6)


LIPS_AND_NOSE = ("mouth_l", "mouth_r", "lip_top", "lip_mid", "lip_bottom", "nostril_l", "nostril_r", "nose_base")


@pytest.mark.parametrize("landmark", LIPS_AND_NOSE)
def test_marys_mouth_is_posed_where_her_head_really_is(mary: Avatar, landmark: str) -> None:
    """Her loop was rendered with known head motion; training found it from the pictures alone."""
    truth = json.loads((mary.folder / "recording" / "pose.json").read_text())
    background = mary.pack.background
    corner = np.array([0.5, 0.5])  # the truth counts from the corner of the first pixel, pictures from its middle
    still = np.array(truth["neutral"][landmark]) - corner - (background.crop.x, background.crop.y)
    first = (background.region.x, background.region.y)
    off, moved = [], []
    for index in range(background.frames):
        real = np.array(truth["poses"][index]["landmarks"][landmark]) - corner
        posed = background.forward(index, still[None].astype(np.float32))[0] + first
        off.append(np.linalg.norm(posed - real))
        moved.append(np.linalg.norm(real - (np.array(truth["neutral"][landmark]) - corner)))
    assert np.sqrt(np.mean(np.square(moved))) > 3.5
    assert np.sqrt(np.mean(np.square(off))) < 0.35
    assert max(off) < 0.7
