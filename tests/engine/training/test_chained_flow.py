from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.training.chained_flow import EDGE, chained_flows, compose, dense_flow, edge_taper
from app.engine.warp import pixel_grid, sample

Float = NDArray[np.float32]
WIDTH, HEIGHT = 96, 72
INSIDE = np.s_[10:-10, 10:-10]


def texture(x: Float, y: Float) -> Float:
    """A pattern without repetition, smooth enough to be read anywhere."""
    waves = 128 + 30 * np.sin(x / 3.3 + y / 7.1) + 25 * np.cos(y / 2.9 - x / 9.7) + 20 * np.sin(x * y / 190 + 1)
    return (waves + 25 * np.sin(x / 5.9) * np.cos(y / 4.3)).astype(np.float32)


def wave(amount: float) -> Float:
    """A smooth flow of up to so many pixels."""
    x, y = np.moveaxis(pixel_grid(WIDTH, HEIGHT), -1, 0)
    return (amount * np.stack([np.sin(y / 14 + 1), np.cos(x / 17)], -1)).astype(np.float32)


def warped(flow_back: Float) -> Float:
    """The picture that shows texture(q + flow_back(q)) at q."""
    where = pixel_grid(WIDTH, HEIGHT) + flow_back
    return texture(where[..., 0], where[..., 1])


def truth(flow_back: Float) -> Float:
    """Forward flow p -> q with q + flow_back(q) = p."""
    points = pixel_grid(WIDTH, HEIGHT).copy()
    q = points.copy()
    for _ in range(50):
        q = points - sample(flow_back, q, smooth=False)
    return q - points


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.5, -0.25), (1.75, 1.1), (-3.3, 2.6)])
def test_translations_are_found_to_a_fraction_of_a_pixel(shift: tuple[float, float]) -> None:
    source = warped(np.zeros((HEIGHT, WIDTH, 2), np.float32))
    target = warped(np.full((HEIGHT, WIDTH, 2), -np.array(shift), np.float32))
    error = np.linalg.norm(dense_flow(source, target) - np.array(shift), axis=-1)[INSIDE]
    assert np.median(error) < 0.1
    assert np.percentile(error, 95) < 0.3


@pytest.mark.parametrize("amount", [0.7, 1.5, 3.0])
def test_smooth_warps_are_found_to_a_fraction_of_a_pixel(amount: float) -> None:
    back = wave(amount)
    flow = dense_flow(warped(0 * back), warped(back))
    error = np.linalg.norm(flow - truth(back), axis=-1)[INSIDE]
    assert np.median(error) < 0.2
    assert np.percentile(error, 95) < 0.6


def test_the_flow_points_from_source_to_target() -> None:
    back = wave(2.0)
    source, target = warped(0 * back), warped(back)
    flow = dense_flow(source, target)
    shown = sample(target, flow + pixel_grid(WIDTH, HEIGHT))
    before = np.abs(target - source)[INSIDE].mean()
    assert np.abs(shown - source)[INSIDE].mean() < 0.2 * before


def test_flows_are_followed_one_after_the_other() -> None:
    grid = pixel_grid(WIDTH, HEIGHT)
    first = np.full((HEIGHT, WIDTH, 2), (2.5, -1), np.float32)
    second = (0.05 * grid[..., ::-1]).astype(np.float32)  # linear, so that it can be read exactly anywhere
    expected = first + 0.05 * (grid + first)[..., ::-1]
    np.testing.assert_allclose(compose(first, second)[INSIDE], expected[INSIDE], atol=5e-3)
    nothing = np.zeros_like(first)
    np.testing.assert_allclose(compose(nothing, second), second, atol=1e-4)
    np.testing.assert_allclose(compose(first, nothing), first)


def test_a_chain_finds_what_one_step_loses() -> None:
    # Fourteen frames, each shifted a little more; the last is farther than the pattern's waves are apart.
    amounts = np.linspace(0, 22, 14)
    order = np.random.default_rng(0).permutation(14)
    frames = {
        int(n): warped(np.full((HEIGHT, WIDTH, 2), (-amount, 0), np.float32))
        for n, amount in zip(order, amounts, strict=True)
    }
    space = np.zeros((14, 1), np.float32)
    space[order, 0] = amounts
    reference = int(order[0])
    told: list[float] = []
    flows = chained_flows(frames.__getitem__, space, reference, neighbours=2, progress=told.append)
    assert flows.shape == (14, HEIGHT, WIDTH, 2)
    assert flows.dtype == np.float16
    assert (flows[reference] == 0).all()
    inside = np.s_[10:-10, 10:-40]  # what stays in the picture
    for number, amount in zip(order, amounts, strict=True):
        error = np.linalg.norm(flows[number].astype(np.float32) - (amount, 0), axis=-1)[inside]
        assert np.median(error) < 0.25, amount
    far = int(order[-1])
    at_once = np.linalg.norm(dense_flow(frames[reference], frames[far]) - (22, 0), axis=-1)[inside]
    chained = np.linalg.norm(flows[far].astype(np.float32) - (22, 0), axis=-1)[inside]
    assert chained.mean() < at_once.mean()
    assert told == sorted(told)
    assert 0 <= told[0] < told[-1] < 1


def test_frames_apart_from_all_others_are_reached_in_one_step() -> None:
    # Two islands: with one neighbour each, frames 2 and 3 only know each other.
    amounts = (0.0, 0.5, 2.0, 2.5)
    frames = [warped(np.full((HEIGHT, WIDTH, 2), (-amount, 0), np.float32)) for amount in amounts]
    space = np.array([[0], [0.1], [100], [100.1]], np.float32)
    flows = chained_flows(frames.__getitem__, space, 0, neighbours=1)
    for flow, amount in zip(flows, amounts, strict=True):
        error = np.linalg.norm(flow.astype(np.float32) - (amount, 0), axis=-1)[INSIDE]
        assert np.median(error) < 0.15, amount


def test_flow_falls_to_zero_at_the_edge() -> None:
    taper = edge_taper(WIDTH, HEIGHT)
    assert taper.shape == (HEIGHT, WIDTH)
    assert (taper[[0, -1]] == 0).all()
    assert (taper[:, [0, -1]] == 0).all()
    assert (taper[EDGE:-EDGE, EDGE:-EDGE] == 1).all()
    assert (np.diff(taper[HEIGHT // 2, : EDGE + 1]) > 0).all()
    np.testing.assert_array_equal(taper, taper[::-1, ::-1])
    frames = [warped(np.full((HEIGHT, WIDTH, 2), (-amount, 0), np.float32)) for amount in (0.0, 2.0)]
    flows = chained_flows(frames.__getitem__, np.array([[0], [1]], np.float32), 0)
    assert (flows[1][[0, -1]] == 0).all()
