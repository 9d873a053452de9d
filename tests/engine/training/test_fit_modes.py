from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.mmm import pull
from app.engine.modes import MESH_STEP, Modes, densify, draw_crop, split_texture
from app.engine.training.appearance import Appearance
from app.engine.training.corpus import Corpus
from app.engine.training.fit_modes import (
    NOTHING,
    Analysis,
    Weights,
    area_ratio,
    fit_flow,
    fit_texture,
    frame_planes,
    pulled_texture,
    skin_layer,
)
from app.engine.training.layout import importance
from app.engine.warp import pixel_grid

Float = NDArray[np.float32]
WIDTH, HEIGHT = 24, 16
PIXELS = WIDTH * HEIGHT * 3 // 2


def soft(width: int = WIDTH, height: int = HEIGHT) -> Float:
    """An importance that is nothing at the edge, and 1 in the middle."""
    x, y = np.arange(width), np.arange(height)
    across = np.clip(np.minimum(x, width - 1 - x) / 6 - 0.3, 0, 1)
    down = np.clip(np.minimum(y, height - 1 - y) / 4 - 0.3, 0, 1)
    return np.outer(down, across).astype(np.float32)


def in_blocks(data: Float, size: int = 7) -> Callable[[], Iterator[Float]]:
    def each() -> Iterator[Float]:
        for start in range(0, len(data), size):
            yield data[start : start + size]

    return each


def low_rank(shape: tuple[int, ...], count: int, seed: int = 0) -> Float:
    """So many samples of few strong directions and a little noise."""
    random = np.random.default_rng(seed)
    size = int(np.prod(shape))
    strong = random.standard_normal((count, 4)) * (20, 12, 7, 4) @ random.standard_normal((4, size))
    return (100 + strong + 0.1 * random.standard_normal((count, size))).reshape(count, *shape).astype(np.float32)


def weighted_svd(data: Float, weight: Float, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and the modes that leave the least weighted error, by a dense decomposition."""
    flat = data.reshape(len(data), -1).astype(np.float64)
    mean, used = flat.mean(0), weight.ravel() > 0
    root = np.sqrt(weight.ravel()[used])
    _, _, axes = np.linalg.svd((flat - mean)[:, used] * root, full_matrices=False)
    modes = np.zeros((count, flat.shape[1]))
    modes[:, used] = axes[:count] / root
    return mean, modes


def test_weights_are_the_importance_of_vertices_and_of_all_three_planes() -> None:
    weights = Weights.of(soft())
    assert weights.flow.shape == (HEIGHT // MESH_STEP, WIDTH // MESH_STEP, 1)
    assert weights.texture.shape == (PIXELS,)
    planes = split_texture(weights.texture, WIDTH, HEIGHT)
    mean = soft().reshape(HEIGHT // 2, 2, WIDTH // 2, 2).mean((1, 3))
    kept = soft() >= NOTHING
    np.testing.assert_allclose(planes.luma, np.where(kept, soft(), 0))
    np.testing.assert_allclose(planes.blue, np.where(mean >= NOTHING, mean, 0), atol=1e-6)
    np.testing.assert_array_equal(planes.red, planes.blue)
    np.testing.assert_allclose(weights.flow[..., 0], np.where(kept, soft(), 0)[::MESH_STEP, ::MESH_STEP])
    assert (weights.texture[weights.texture > 0] >= NOTHING).all()


def test_texture_modes_are_those_of_a_dense_weighted_decomposition() -> None:
    weights, data = Weights.of(soft()), low_rank((PIXELS,), 60)
    mean, modes = fit_texture(in_blocks(data), weights, count=4, seed=1)
    expected_mean, expected = weighted_svd(data, weights.texture, 4)
    np.testing.assert_allclose(mean, expected_mean, rtol=1e-5)
    for found, wanted in zip(modes, expected, strict=True):
        sign = np.sign((found * wanted * weights.texture).sum())
        np.testing.assert_allclose(found * sign, wanted, atol=2e-3 * np.abs(wanted).max())
    assert not modes[:, weights.texture == 0].any()
    assert mean[weights.texture == 0].all(), "what does not count still has a mean to be drawn"


def test_flow_modes_are_those_of_a_dense_weighted_decomposition() -> None:
    weights = Weights.of(soft())
    mesh = (*weights.flow.shape[:2], 2)
    data = low_rank(mesh, 50, seed=3)
    mean, modes = fit_flow(in_blocks(data), weights, count=3)
    assert (mean.shape, modes.shape) == (mesh, (3, *mesh))
    expected_mean, expected = weighted_svd(data, np.broadcast_to(weights.flow, mesh), 3)
    np.testing.assert_allclose(mean.ravel(), expected_mean, rtol=1e-5)
    projector = modes.reshape(3, -1)
    for found, wanted in zip(projector, expected, strict=True):
        np.testing.assert_allclose(np.abs(found), np.abs(wanted), atol=2e-3 * np.abs(wanted).max())
    assert not modes[:, weights.flow[..., 0] == 0].any()


def test_errors_that_count_more_are_smaller() -> None:
    # Two directions, the louder one where nothing is important: one mode must be the other.
    important = soft(WIDTH, HEIGHT) * 0.05 + NOTHING
    important[:, 12:] = 1
    weights = Weights.of(important)
    random = np.random.default_rng(0)
    left = split_texture(np.zeros(PIXELS, np.float32), WIDTH, HEIGHT)
    left.luma[:, :12] = 1
    right = split_texture(np.zeros(PIXELS, np.float32), WIDTH, HEIGHT)
    right.luma[:, 12:] = 1
    flat_left, flat_right = (np.concatenate([plane.ravel() for plane in each.each()]) for each in (left, right))
    data = random.standard_normal((40, 1)) * 3 * flat_left + random.standard_normal((40, 1)) * flat_right
    _, modes = fit_texture(in_blocks(data.astype(np.float32)), weights, count=1)
    shares = [np.abs(modes[0] @ each) / each.sum() for each in (flat_left, flat_right)]
    assert shares[1] > 5 * shares[0]


def test_modes_are_orthonormal_where_and_as_much_as_errors_count(corpus: Corpus, appearance: Appearance) -> None:
    modes = appearance.modes
    weights = Weights.of(importance(corpus.crop, corpus.layout.side))
    assert (modes.flow_count, modes.count) == (12, 46)
    for axes, weight in (
        (modes.flow_modes.reshape(modes.flow_count, -1), np.repeat(weights.flow.ravel(), 2)),
        (modes.texture_modes, weights.texture),
    ):
        np.testing.assert_allclose((axes * weight) @ axes.T, np.eye(len(axes)), atol=2e-3)
        assert not axes[:, weight == 0].any()


def bumps(seed: int, count: int) -> Modes:
    """Modes as training makes them, of smooth flows and smooth textures."""
    random = np.random.default_rng(seed)
    weights = Weights.of(soft(64, 48))
    y, x = np.mgrid[:48, :64] / 10.0
    waves = np.stack([np.cos(x * a + b) * np.cos(y * c + d) for a, b, c, d in random.uniform(0.2, 1.2, (40, 4))])
    fade = soft(64, 48)[::MESH_STEP, ::MESH_STEP, None]
    flows = random.standard_normal((60, 4)) @ waves[:8, ::MESH_STEP, ::MESH_STEP].reshape(4, -1)
    flows = (0.3 * flows.reshape(60, 24, 32, 2) * fade).astype(np.float32)
    halves = waves[:, ::2, ::2].reshape(40, -1)
    planes = np.concatenate([waves.reshape(40, -1), halves, halves[::-1]], 1)
    textures = (120 + 12 * random.standard_normal((60, count)) @ planes[:count]).astype(np.float32)
    flow_mean, flow_modes = fit_flow(in_blocks(flows), weights, count=3)
    mean, texture_modes = fit_texture(in_blocks(textures), weights, count=count)
    layer = np.ones((24, 32), np.float32)
    return Modes(64, 48, flow_mean, flow_modes, mean, texture_modes, layer, np.zeros_like(mean))


def test_analysis_finds_the_coefficients_that_a_frame_was_drawn_with() -> None:
    modes = bumps(1, 5)
    weights = Weights.of(soft(64, 48))
    analysis = Analysis(modes, weights)
    random = np.random.default_rng(2)
    for _ in range(5):
        wanted = np.concatenate([random.normal(0, 4, 3), random.normal(0, 150, 5)]).astype(np.float32)
        drawn = draw_crop(modes, wanted)
        flat = np.concatenate([np.clip(np.rint(plane), 0, 255).astype(np.uint8).ravel() for plane in drawn.each()])
        found = analysis(flat, modes.flow(wanted))
        np.testing.assert_allclose(found[:3], wanted[:3], atol=1e-2)
        np.testing.assert_allclose(found[3:], wanted[3:], atol=12)  # frames are rounded, and interpolated twice
    exact = modes.texture(wanted, detail=False)
    flat = np.concatenate([plane.ravel() for plane in exact.each()])
    np.testing.assert_allclose(analysis.texture(flat), wanted[3:], atol=0.05)


def test_analysis_solves_the_weighted_least_squares() -> None:
    modes, weights = bumps(3, 4), Weights.of(soft(64, 48))
    texture = (100 + 30 * np.random.default_rng(0).standard_normal(len(weights.texture))).astype(np.float32)
    root = np.sqrt(weights.texture.astype(np.float64))
    expected = np.linalg.lstsq(
        (modes.texture_modes * root).T, (texture - modes.texture_mean) * root, rcond=None
    )[0]  # fmt: skip
    np.testing.assert_allclose(Analysis(modes, weights).texture(texture), expected, atol=0.05)


def test_what_lies_outside_the_mask_is_never_looked_at(corpus: Corpus, appearance: Appearance) -> None:
    weights = Weights.of(importance(corpus.crop, corpus.layout.side))
    analysis = Analysis(appearance.modes, weights)
    texture = corpus.frames.read(60, 61)[0].astype(np.float32)
    poisoned = np.where(weights.texture == 0, 1e6, texture).astype(np.float32)
    np.testing.assert_array_equal(analysis.texture(texture), analysis.texture(poisoned))
    vertices = appearance.modes.flow(appearance.coefficients[60])
    wild = np.where(weights.flow == 0, 1e6, vertices).astype(np.float32)
    np.testing.assert_array_equal(analysis.flow(vertices), analysis.flow(wild))


def test_frames_are_split_into_float_planes(corpus: Corpus) -> None:
    flat = corpus.frames.read(7, 8)[0]
    planes = frame_planes(flat, 64, 56)
    assert [plane.shape for plane in planes.each()] == [(56, 64), (28, 32), (28, 32)]
    assert planes.luma.dtype == np.float32
    assert planes.luma[3, 5] == flat[3 * 64 + 5]
    assert planes.red[2, 1] == flat[64 * 56 + 32 * 28 + 2 * 32 + 1]


def test_textures_are_seen_through_the_flow_of_the_coefficients(corpus: Corpus, appearance: Appearance) -> None:
    modes, flat, coefficients = appearance.modes, corpus.frames.read(90, 91)[0], appearance.coefficients[90]
    expected = pull(frame_planes(flat, 64, 56), densify(modes.flow(coefficients), 64, 56))
    np.testing.assert_allclose(pulled_texture(modes, flat, coefficients[: modes.flow_count]), expected, atol=1e-2)


@pytest.mark.parametrize(
    ("matrix", "ratio"),
    [
        (((1, 0), (0, 1)), 1),
        (((2, 0), (0, 0.5)), 1),
        (((0.5, 0), (0, 0.5)), 0.25),
        (((1, 0.3), (-0.2, 1)), 1.06),
        (((-1, 0), (0, 1)), -1),
    ],
)
def test_the_area_of_a_cell_is_the_determinant_of_the_map(
    matrix: tuple[tuple[float, float], ...], ratio: float
) -> None:
    points = pixel_grid(40, 30)[::MESH_STEP, ::MESH_STEP]
    flow = points @ (np.array(matrix).T - np.eye(2))
    np.testing.assert_allclose(area_ratio(flow.astype(np.float32)), ratio, atol=1e-4)


def test_what_is_squashed_at_rest_is_behind(appearance: Appearance) -> None:
    flow = np.zeros((20, 30, 2), np.float32)
    flow[8:12, 10:20, 1] = -np.arange(4)[:, None] * MESH_STEP  # four rows that fall together
    flow[12:, 10:20, 1] = -4 * MESH_STEP
    layer = skin_layer(flow)
    assert set(np.unique(layer)) == {0, 1}
    assert (layer[9:12, 12:18] == 0).all()
    assert (layer[:7] == 1).all()
    assert (layer[15:] == 1).all()
    assert (layer[:, :8] == 1).all()
    # The drawn mouth is hidden in its middle and nowhere at the edge.
    assert (appearance.modes.layer[10:18, 12:20] == 0).any()
    assert (appearance.modes.layer[[0, -1]] == 1).all()
