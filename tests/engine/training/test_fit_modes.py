from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.mmm import pull
from app.engine.modes import MESH_STEP, Modes, densify, draw_crop
from app.engine.training.fit_modes import area_ratio, fit_modes, frame_planes, skin_layer
from app.engine.training.recording import Recording
from app.engine.training.train import Trained, learn
from app.engine.warp import pixel_grid

Float = NDArray[np.float32]


@pytest.fixture(scope="module")
def trained(recording: Recording) -> Trained:
    return learn(recording)


def test_frames_are_split_into_float_planes(recording: Recording) -> None:
    planes = frame_planes(recording.frames[0], 64, 48)
    assert [plane.shape for plane in planes.each()] == [(48, 64), (24, 32), (24, 32)]
    assert planes.luma.dtype == np.float32
    assert planes.luma[3, 5] == recording.frames[0][3 * 64 + 5]
    assert planes.red[2, 1] == recording.frames[0][64 * 48 + 32 * 24 + 2 * 32 + 1]


def test_every_recorded_frame_is_drawn_again_from_its_coefficients(recording: Recording, trained: Trained) -> None:
    ratios = []
    for flat, coefficients in zip(recording.frames, trained.coefficients, strict=True):
        drawn, shown = draw_crop(trained.modes, coefficients), frame_planes(flat, 64, 48)
        error = ((drawn.luma - shown.luma)[4:-4, 4:-4] ** 2).mean()
        ratios.append(10 * np.log10(255**2 / error))
    still = frame_planes(recording.frames[0], 64, 48).luma
    without = [
        10 * np.log10(255**2 / max(1e-9, ((frame_planes(f, 64, 48).luma - still) ** 2).mean()))
        for f in recording.frames
    ]
    assert np.mean(ratios) > 30
    assert min(ratios) > 26
    assert min(ratios) > min(without) + 6


def test_coefficients_are_decorrelated_and_modes_orthonormal(trained: Trained) -> None:
    modes, count = trained.modes, trained.modes.flow_count
    for axes, part in (
        (modes.flow_modes.reshape(count, -1), trained.coefficients[:, :count]),
        (modes.texture_modes, trained.coefficients[:, count:]),
    ):
        np.testing.assert_allclose(axes @ axes.T, np.eye(len(axes)), atol=1e-3)
        covariance = np.cov(part.T, bias=True)
        spread = np.sqrt(np.diag(covariance))
        assert np.abs(covariance / np.outer(spread, spread) - np.eye(len(axes))).max() < 0.05
        assert (np.diff(spread) <= 1e-3 * spread[:-1]).all()


def test_textures_are_projections_of_the_pulled_frames(recording: Recording, trained: Trained) -> None:
    modes, frame = trained.modes, 20
    coefficients = trained.coefficients[frame]
    flat = pull(frame_planes(recording.frames[frame], 64, 48), densify(modes.flow(coefficients), 64, 48))
    expected = modes.texture_modes @ (flat - modes.texture_mean)
    np.testing.assert_allclose(coefficients[modes.flow_count :], expected, atol=0.5)  # textures are held in half floats


def test_as_many_modes_are_made_as_are_asked_for(recording: Recording) -> None:
    flows = np.random.default_rng(0).standard_normal((88, 48, 64, 2)).astype(np.float16)
    modes, coefficients = fit_modes(
        recording.frames, flows, 64, 48, rest=np.arange(5), flow_count=3, texture_count=4, seed=1
    )
    assert isinstance(modes, Modes)
    assert modes.flow_modes.shape == (3, 24, 32, 2)
    assert modes.texture_modes.shape == (4, 64 * 48 * 3 // 2)
    assert coefficients.shape == (88, 7)
    assert not modes.detail.any()


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


def test_what_is_squashed_at_rest_is_behind(trained: Trained) -> None:
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
    middle = trained.modes.layer[8:16, 12:20]
    assert (middle == 0).any()
    assert (trained.modes.layer[[0, -1]] == 1).all()
