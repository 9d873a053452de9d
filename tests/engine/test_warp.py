from __future__ import annotations

import numpy as np
import pytest
from appendix_a import warp as literal_warp
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine.warp import blend, fill_holes, forward_warp, halve_map, invert_mesh, pixel_grid, sample

Float = NDArray[np.float32]


def push(image: Float, flow: Float) -> tuple[Float, NDArray[np.bool_]]:
    out, hit = np.empty_like(image), np.empty(image.shape[:2], np.bool_)
    forward_warp(image, flow, out, hit)
    return out, hit


@given(st.integers(1, 9), st.integers(1, 9), st.floats(0, 6), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_forward_warp_is_the_printed_one(width: int, height: int, reach: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    image = random.uniform(0, 255, (height, width, 2)).astype(np.float32)
    flow = (random.uniform(-1, 1, (height, width, 2)) * reach).astype(np.float32)
    np.testing.assert_allclose(push(image, flow)[0], literal_warp(image, flow), rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("half", [0.5, -0.5, 1.5, -1.5])
def test_halves_are_rounded_as_printed(half: float) -> None:
    image = np.arange(63, dtype=np.float32).reshape(7, 9, 1)
    flow = np.full((7, 9, 2), half, np.float32)
    np.testing.assert_array_equal(push(image, flow)[0], literal_warp(image, flow))


def test_whole_pixels_move_whole_pixels() -> None:
    image = np.random.default_rng(0).uniform(0, 255, (6, 8, 3)).astype(np.float32)
    out, hit = push(image, np.full((6, 8, 2), (2, -1), np.float32))
    np.testing.assert_array_equal(out[:5, 2:], image[1:, :6])
    assert hit[:5, 2:].all()
    assert hit.sum() == 30


def test_of_two_pixels_in_one_place_the_later_wins() -> None:
    image = np.array([[[1], [2], [3]]], np.float32)
    flow = np.zeros((1, 3, 2), np.float32)
    flow[0, :, 0] = (2, 1, 0)
    assert push(image, flow)[0].ravel().tolist() == [3, 3, 3]


def test_holes_are_the_mean_of_the_nearest_in_four_directions_and_dark_is_no_hole() -> None:
    image = np.zeros((5, 5, 1), np.float32)
    hit = np.zeros((5, 5), np.bool_)
    for (y, x), level in {(2, 0): 10, (2, 4): 30, (0, 2): 0, (4, 2): 40, (3, 2): 60}.items():
        image[y, x], hit[y, x] = level, True
    fill_holes(image, hit)
    assert image[2, 2, 0] == (10 + 30 + 0 + 60) / 4  # 40 is hidden behind 60, and the dark 0 counts
    assert image[0, 2, 0] == 0
    assert image[1, 1, 0] == 0  # nothing in sight


@pytest.mark.parametrize("smooth", [True, False])
def test_sampling_at_the_pixels_changes_nothing(smooth: bool) -> None:
    plane = np.random.default_rng(0).uniform(0, 255, (10, 12)).astype(np.float32)
    np.testing.assert_allclose(sample(plane, pixel_grid(12, 10), smooth=smooth), plane, atol=1e-4)


@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize("shift", [(0.5, 0.25), (-0.25, 0.75)])
def test_sampling_between_pixels_finds_the_place_on_a_slope(smooth: bool, shift: tuple[float, float]) -> None:
    grid = pixel_grid(20, 16)
    plane = np.ascontiguousarray(3 * grid[..., 0] - 2 * grid[..., 1])
    expected = plane + 3 * shift[0] - 2 * shift[1]
    sampled = sample(plane, grid + np.array(shift, np.float32), smooth=smooth)
    # Exact if linear; OpenCV's cubic kernel (a = -0.75) is off by up to 0.03 pixels of the slope.
    off = 0.04 * (3 + 2) if smooth else 1e-3
    np.testing.assert_allclose(sampled[3:-3, 3:-3], expected[3:-3, 3:-3], atol=off)


def test_beyond_the_edge_the_edge_goes_on_or_nothing_is_there() -> None:
    plane = np.full((4, 4), 7, np.float32)
    outside = np.full((2, 2, 2), -20, np.float32)
    assert (sample(plane, outside) == 7).all()
    assert (sample(plane, outside, zero_outside=True) == 0).all()


def test_sampling_writes_where_it_is_told() -> None:
    plane, out = np.full((4, 4), 7, np.float32), np.zeros((4, 4), np.float32)
    assert sample(plane, pixel_grid(4, 4), out=out) is out
    assert (out == 7).all()


def test_the_shared_grid_counts_x_then_y_and_cannot_be_written() -> None:
    grid = pixel_grid(5, 3)
    assert grid.shape == (3, 5, 2)
    assert grid[2, 4].tolist() == [4, 2]
    with pytest.raises(ValueError, match="read-only"):
        grid[0, 0, 0] = 1


STEP = 2


def mesh(width: int, height: int) -> tuple[Float, Float]:
    points = pixel_grid(width, height)[::STEP, ::STEP]
    return points[..., 0].copy(), points[..., 1].copy()


def invert(x: Float, y: Float, width: int, height: int, layer: Float | None = None) -> Float:
    out = np.full((height, width, 2), -99, np.float32)
    depth = np.empty((height, width), np.float32)
    invert_mesh(x, y, STEP, np.ones_like(x) if layer is None else layer, out, depth)
    return out


def test_a_mesh_at_rest_is_its_own_inverse_and_what_it_misses_is_left_alone() -> None:
    out = invert(*mesh(12, 10), 12, 10)
    np.testing.assert_allclose(out[:9, :11], pixel_grid(12, 10)[:9, :11], atol=1e-5)  # vertices end at 10 and 8
    assert (out[9:] == -99).all()
    assert (out[:, 11:] == -99).all()


@pytest.mark.parametrize(
    ("matrix", "shift"),
    [
        (((1, 0), (0, 1)), (0.3, -0.7)),
        (((1.7, 0), (0, 0.6)), (2.1, 3.3)),
        (((0.95, -0.3), (0.3, 0.95)), (4.5, 1.25)),
        (((1, 0.4), (0.1, 1.2)), (-1.1, 0.4)),
    ],
)
def test_affine_maps_are_inverted_exactly(matrix: tuple[tuple[float, float], ...], shift: tuple[float, float]) -> None:
    width, height = 40, 30
    forward = np.array(matrix)
    texture = np.stack(mesh(width, height), -1)
    shown = texture @ forward.T + shift
    out = invert(*np.moveaxis(shown, -1, 0).astype(np.float32).copy(), width, height)
    expected = (pixel_grid(width, height) - shift) @ np.linalg.inv(forward).T
    drawn = out[..., 0] != -99
    inside = ((expected >= 0.02) & (expected <= np.array([width - 2, height - 2]) - 0.02)).all(-1)
    assert inside.sum() > 200
    assert drawn[inside].all()
    assert not drawn[((expected < -0.02) | (expected > np.array([width - 2, height - 2]) + 0.02)).any(-1)].any()
    np.testing.assert_allclose(out[drawn], expected[drawn], atol=2e-3)


def test_smooth_maps_are_inverted_to_a_fraction_of_a_pixel() -> None:
    width, height = 60, 50
    x, y = mesh(width, height)
    out = invert(x + 2 * np.sin(y / 7).astype(np.float32), y + 3 * np.sin(x / 9).astype(np.float32), width, height)
    drawn = out[..., 0] != -99
    u, v = out[..., 0][drawn], out[..., 1][drawn]
    there = np.stack([u + 2 * np.sin(v / 7), v + 3 * np.sin(u / 9)], -1)
    assert drawn.sum() > 0.8 * width * height
    assert np.abs(there - pixel_grid(width, height)[drawn]).max() < 0.06  # the chords of the mesh


def test_a_slit_that_opens_wide_is_inverted() -> None:
    # Vertices above row 10 go up by 8, those below down by 8: a fixed-point inversion diverges here.
    x, y = mesh(24, 40)
    moved = y + np.where(y < 20, -8, 8).astype(np.float32)
    out = invert(x, moved, 24, 40)
    np.testing.assert_allclose(out[:10, 4, 1], np.arange(10) + 8, atol=1e-3)
    np.testing.assert_allclose(out[28:, 4, 1][:10], np.arange(28, 38) - 8, atol=1e-3)
    between = out[10:28, 4, 1]
    assert (np.diff(between) >= 0).all()
    assert between[0] >= 18
    assert between[-1] <= 20.001


@pytest.mark.parametrize("front", ["left", "right"])
def test_where_the_mesh_folds_the_nearer_layer_is_seen(front: str) -> None:
    # The columns right of the middle are shown 6 pixels further left, over their neighbours.
    width, height = 40, 8
    x, y = mesh(width, height)
    right = x >= 20
    layer = np.where(right == (front == "right"), 1, 0).astype(np.float32)
    out = invert(np.where(right, x - 6, x).astype(np.float32), y, width, height, layer)
    overlap = out[2, 15:17, 0]  # shown by texture columns 15 to 17 and 21 to 23
    np.testing.assert_allclose(overlap, [21, 22] if front == "right" else [15, 16], atol=1e-3)


def test_a_triangle_turned_over_is_behind_all_others() -> None:
    x, y = mesh(40, 8)
    shown = np.where(x >= 20, x - 6, x).astype(np.float32)
    layer = np.zeros_like(x)
    layer[:, 9:11] = 5  # the strip between 18 and 20 is turned over, though it claims to be nearest
    out = invert(shown, y, 40, 8, layer)
    assert not ((out[2, 15:17, 0] > 18.01) & (out[2, 15:17, 0] < 19.99)).any()


def test_meshes_far_outside_or_without_area_draw_nothing() -> None:
    x, y = mesh(12, 10)
    assert (invert(x + 1000, y, 12, 10) == -99).all()
    assert (invert(np.full_like(x, 3), y, 12, 10) == -99).all()


def test_chroma_maps_are_luma_maps_at_the_chroma_places() -> None:
    x, y = np.moveaxis(pixel_grid(16, 12), -1, 0)
    luma = np.stack([1.5 * x + 0.5 * y + 3, 0.25 * x + 2 * y - 1], -1).astype(np.float32)
    half = np.empty((6, 8, 2), np.float32)
    halve_map(luma, half)
    j, i = np.mgrid[:6, :8]
    shown_x, shown_y = 2 * i, 2 * j + 0.5  # where the chroma sample is in the picture
    np.testing.assert_allclose(half[..., 0], (1.5 * shown_x + 0.5 * shown_y + 3) / 2, atol=1e-4)
    np.testing.assert_allclose(half[..., 1], (0.25 * shown_x + 2 * shown_y - 1 - 0.5) / 2, atol=1e-4)


def test_blending_is_base_plus_weighted_texture_rounded_and_clipped() -> None:
    random = np.random.default_rng(0)
    base = random.integers(-16000, 16000, (20, 30)).astype(np.int16)
    mask = random.integers(0, 256, (20, 30)).astype(np.uint8)
    texture = random.uniform(-20, 280, (20, 30)).astype(np.float32)
    picture = np.zeros((24, 40), np.uint8)
    blend(base, mask, texture, picture[2:22, 5:35])
    exact = base / 64 + mask / 255 * texture.astype(np.float64)
    assert np.abs(picture[2:22, 5:35] - np.clip(exact, 0, 255)).max() < 0.501
    assert picture[:2].sum() == picture[22:].sum() == picture[:, :5].sum() == picture[:, 35:].sum() == 0
