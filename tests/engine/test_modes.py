from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.avatar import Avatar
from app.engine.background import Background, Planes
from app.engine.evaluation.talker import side_of
from app.engine.modes import MESH_STEP, ModeMouth, Modes, densify, draw_crop, split_texture
from app.engine.training.fit_modes import Weights
from app.engine.training.layout import importance
from app.engine.warp import pixel_grid

Float = NDArray[np.float32]
COEFFICIENTS = np.array([1.5, -2, 3, -1, 0.5], np.float32)


@pytest.fixture
def unmoved(modes: Modes) -> Modes:
    """Without flow, so that the texture is shown where it is."""
    return replace(modes, flow_mean=np.zeros_like(modes.flow_mean), flow_modes=np.zeros_like(modes.flow_modes))


def test_flow_and_texture_are_linear_in_their_coefficients(modes: Modes) -> None:
    assert (modes.flow_count, modes.count) == (2, 5)
    flow = modes.flow_mean + 1.5 * modes.flow_modes[0] - 2 * modes.flow_modes[1]
    np.testing.assert_allclose(modes.flow(COEFFICIENTS), flow, atol=1e-5)
    flat = modes.texture_mean + 3 * modes.texture_modes[0] - modes.texture_modes[1] + 0.5 * modes.texture_modes[2]
    for detail, expected in ((False, flat), (True, flat + modes.detail)):
        shown = modes.texture(COEFFICIENTS, detail=detail)
        for plane, other in zip(shown.each(), split_texture(expected, 24, 20).each(), strict=True):
            np.testing.assert_allclose(plane, other, atol=1e-4)


def test_textures_are_split_into_views() -> None:
    flat = np.arange(36, dtype=np.float32)
    split = split_texture(flat, 6, 4)
    assert split.luma[1, 2] == 8
    assert split.blue.tolist() == [[24, 25, 26], [27, 28, 29]]
    assert split.red.tolist() == [[30, 31, 32], [33, 34, 35]]
    assert all(np.shares_memory(plane, flat) for plane in split.each())


def test_flow_between_the_vertices_is_interpolated() -> None:
    grid = pixel_grid(24, 20)
    flow = np.stack([2 * grid[..., 0] + grid[..., 1], grid[..., 0] - 3 * grid[..., 1]], -1)
    dense = densify(flow[::MESH_STEP, ::MESH_STEP], 24, 20)
    np.testing.assert_allclose(dense[:-1, :-1], flow[:-1, :-1], atol=1e-3)


def test_a_crop_without_flow_is_the_texture_without_detail(unmoved: Modes) -> None:
    drawn = draw_crop(unmoved, COEFFICIENTS)
    for plane, texture in zip(drawn.each(), unmoved.texture(COEFFICIENTS, detail=False).each(), strict=True):
        np.testing.assert_allclose(plane, texture, atol=1e-3)


def test_a_flow_moves_the_texture_by_fractions_of_a_pixel(unmoved: Modes) -> None:
    x, y = np.moveaxis(pixel_grid(24, 20), -1, 0)
    half_x, half_y = np.moveaxis(pixel_grid(12, 10), -1, 0)
    texture = np.concatenate([(4 * x + 3 * y).ravel(), (2 * half_x).ravel(), (5 * half_y).ravel()])
    moved = replace(
        unmoved,
        flow_mean=np.full_like(unmoved.flow_mean, (0.5, -1.25)),
        texture_mean=texture.astype(np.float32),
        texture_modes=np.zeros_like(unmoved.texture_modes),
    )
    drawn = draw_crop(moved, COEFFICIENTS)
    inside = np.s_[3:-5, 3:-3]  # what comes from the middle of the texture
    np.testing.assert_allclose(drawn.luma[inside], (4 * (x - 0.5) + 3 * (y + 1.25))[inside], atol=0.25)
    inside = np.s_[3:-4, 3:-3]
    np.testing.assert_allclose(drawn.blue[inside], (2 * (half_x - 0.25))[inside], atol=0.1)
    np.testing.assert_allclose(drawn.red[inside], (5 * (half_y + 0.625))[inside], atol=0.2)


def drawn_in_region(modes: Modes, background: Background, index: int, coefficients: Float) -> Planes:
    out = Planes.empty(background.region.width, background.region.height)
    ModeMouth(modes, background).draw(coefficients, index, out)
    return out


def test_without_head_motion_the_region_shows_the_crop(modes: Modes, background: Background) -> None:
    # Index 4 is the still: the same pose as index 0, but no detail.
    shown = drawn_in_region(modes, background, 4, COEFFICIENTS)
    crop = draw_crop(modes, COEFFICIENTS)
    np.testing.assert_allclose(shown.luma[10:24, 10:28], crop.luma[2:16, 2:20], atol=1e-2)
    np.testing.assert_allclose(shown.blue[5:12, 5:14], crop.blue[1:8, 1:10], atol=1e-2)


def test_detail_is_drawn_on_the_loop_and_not_on_the_still(unmoved: Modes, background: Background) -> None:
    loop, still = (drawn_in_region(unmoved, background, index, COEFFICIENTS) for index in (0, 4))
    detail = split_texture(unmoved.detail, 24, 20)
    np.testing.assert_allclose((loop.luma - still.luma)[10:26, 10:30], detail.luma[2:18, 2:22], atol=1e-2)


@pytest.mark.parametrize(("index", "shift"), [(1, (3, -1)), (2, (-0.5, 1.25)), (3, (2.3, 0.7))])
def test_the_mouth_moves_with_the_head(
    unmoved: Modes, background: Background, index: int, shift: tuple[float, float]
) -> None:
    x, y = np.moveaxis(pixel_grid(24, 20), -1, 0)
    half_x, half_y = np.moveaxis(pixel_grid(12, 10), -1, 0)
    texture = np.concatenate([(4 * x + 3 * y).ravel(), (2 * half_x).ravel(), (5 * half_y).ravel()])
    ramp = replace(
        unmoved,
        texture_mean=texture.astype(np.float32),
        texture_modes=np.zeros_like(unmoved.texture_modes),
        detail=np.zeros_like(unmoved.detail),
    )
    shown = drawn_in_region(ramp, background, index, COEFFICIENTS)
    column, row = np.moveaxis(pixel_grid(40, 36), -1, 0)
    inside = np.s_[14:22, 14:26]
    expected = 4 * (column - 8 + shift[0]) + 3 * (row - 8 + shift[1])
    np.testing.assert_allclose(shown.luma[inside], expected[inside], atol=0.25)
    column, row = np.moveaxis(pixel_grid(20, 18), -1, 0)
    inside = np.s_[7:11, 7:13]
    np.testing.assert_allclose(shown.blue[inside], (2 * (column - 4 + shift[0] / 2))[inside], atol=0.1)
    np.testing.assert_allclose(shown.red[inside], (5 * (row - 4 + shift[1] / 2))[inside], atol=0.2)


def test_marys_modes_are_orthonormal_and_ordered(mary: Avatar, spoken: Float) -> None:
    modes = mary.pack.modes
    weights = Weights.of(importance(mary.pack.background.crop, side_of(modes, mary.pack.background.crop)))
    flow_weights = np.repeat(weights.flow.ravel(), 2)
    flow_modes = modes.flow_modes.reshape(modes.flow_count, -1)
    for axes, weight in ((flow_modes, flow_weights), (modes.texture_modes, weights.texture)):
        gram = (axes * weight).astype(np.float64) @ axes.T.astype(np.float64)
        np.testing.assert_allclose(gram, np.eye(len(axes)), atol=6e-3)
    assert spoken.shape[1] == modes.count == modes.flow_count + len(modes.texture_modes)
    spread = mary.pack.trajectory.scale
    for part in (spread[: modes.flow_count], spread[modes.flow_count :]):
        assert (np.diff(part) <= 1e-3 * part[:-1]).all()


def test_marys_lips_and_skin_are_in_front_of_the_inside_of_her_mouth(mary: Avatar) -> None:
    layer = mary.pack.modes.layer
    assert set(np.unique(layer)) == {0, 1}
    assert 0.005 < (layer == 0).mean() < 0.2
    assert (layer[0] == 1).all()
    assert (layer[:, 0] == 1).all()
