from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.training.landmark_flow import (
    EDGE,
    Landmarks,
    chain,
    choose_landmarks,
    compose,
    dense_flow,
    edge_taper,
)
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


def shifted(amount: float) -> Float:
    """The pattern moved to the right by so many pixels."""
    return warped(np.full((HEIGHT, WIDTH, 2), (-amount, 0), np.float32))


def truth(flow_back: Float) -> Float:
    """Forward flow p -> q with q + flow_back(q) = p."""
    points = pixel_grid(WIDTH, HEIGHT).copy()
    q = points.copy()
    for _ in range(50):
        q = points - sample(flow_back, q, smooth=False)
    return q - points


def off(flow: NDArray[np.float16] | Float, amount: float, where: tuple[slice, slice] = INSIDE) -> Float:
    error: Float = np.linalg.norm(flow.astype(np.float32) - (amount, 0), axis=-1)[where]
    return error


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
    luma, space = np.empty((14, HEIGHT, WIDTH), np.float32), np.zeros((14, 1), np.float32)
    for place, amount in zip(order, amounts, strict=True):
        luma[place], space[place] = shifted(float(amount)), amount
    reference, far = int(order[0]), int(order[-1])
    told: list[float] = []
    found = chain(luma, space, reference, progress=told.append)
    assert found.flows.shape == (14, HEIGHT, WIDTH, 2)
    assert found.flows.dtype == np.float16
    assert found.reference == reference
    assert (found.flows[reference] == 0).all()
    inside = np.s_[10:-10, 10:-40]  # what stays in the picture
    at_once = off(dense_flow(luma[reference], luma[far]), 22, inside)
    assert off(found.flows[far], 22, inside).mean() < 0.5 * at_once.mean()
    assert told == sorted(told)
    assert 0 <= told[0] < told[-1] < 1


def parted(skin: Float, amount: float) -> Float:
    """Rows at which points of skin (relative to where the lips meet, by column) lie when the lips part so far."""
    wide = amount * np.exp(-(((np.arange(WIDTH) - 48) / 22) ** 2))
    moved: Float = 36 + skin + np.sign(skin) * wide * np.exp(-np.abs(skin) / 20)
    return moved


def mouth(amount: float) -> tuple[Float, Float]:
    """A mouth whose lips have parted so far: its picture, dark inside, and which point of the skin each pixel shows."""
    fine = np.linspace(-60, 60, 4000)[:, None] * np.ones(WIDTH)
    rows = parted(fine, amount)
    skin = np.stack([np.interp(np.arange(HEIGHT), rows[:, x], fine[:, x]) for x in range(WIDTH)], 1)
    inside = np.abs(skin) < 0.02
    shown = texture(np.tile(np.arange(WIDTH, dtype=np.float32), (HEIGHT, 1)), skin + 36)
    return np.where(inside & (amount > 0), 20, shown).astype(np.float32), skin


def test_a_mouth_opened_wide_is_closed_better_in_small_steps() -> None:
    amounts = np.linspace(15, 0, 16)
    luma = np.stack([mouth(float(amount))[0] for amount in amounts])
    found = chain(luma, amounts[:, None].astype(np.float32), 0)
    _, skin = mouth(15.0)
    down = parted(skin, 0.0) - np.arange(HEIGHT)[:, None]
    lips = (np.abs(skin) > 0.5) & (np.abs(skin) < 12) & (np.abs(np.arange(WIDTH) - 48) < 20)
    chained, at_once = (
        np.abs(flow[..., 1].astype(np.float32) - down)[lips]
        for flow in (found.flows[-1], dense_flow(luma[0], luma[-1]))
    )
    assert chained.mean() < 0.6 * at_once.mean(), (chained.mean(), at_once.mean())


def test_frames_apart_from_all_others_are_reached_in_one_step() -> None:
    # Two islands: with nine frames each that are all nearest to each other, no edge leads from one to the other.
    amounts = np.concatenate([np.linspace(0, 0.8, 9), np.linspace(2, 2.8, 9)])
    luma = np.stack([shifted(float(amount)) for amount in amounts])
    space = np.concatenate([np.linspace(0, 1, 9), np.linspace(100, 101, 9)])[:, None].astype(np.float32)
    found = chain(luma, space, 4)
    for flow, amount in zip(found.flows, amounts, strict=True):
        assert np.median(off(flow, amount - amounts[4])) < 0.2, amount
    assert (found.flows[:, [0, -1]] == 0).all(), "tapered at the edge, as all others are"


def test_landmarks_are_each_the_farthest_from_those_before() -> None:
    random = np.random.default_rng(0)
    space = random.standard_normal((60, 3)).astype(np.float32)
    chosen = [7, 30]
    while len(chosen) < 15:
        best, farthest = -1.0, -1
        for frame in range(60):
            nearest = min(float(((space[frame] - space[other]) ** 2).sum()) for other in chosen)
            if nearest > best and frame not in chosen:
                best, farthest = nearest, frame
        chosen.append(farthest)
    assert choose_landmarks(space, [7, 30, 7], 15).tolist() == sorted(chosen)


def test_landmarks_are_no_more_than_there_are_frames_and_each_is_one_once() -> None:
    space = np.zeros((9, 2), np.float32)  # all alike
    assert choose_landmarks(space, [4], 400).tolist() == list(range(9))
    assert {2, 4} < set(choose_landmarks(space, [4, 2], 3).tolist())
    assert len(set(choose_landmarks(space, [4], 5).tolist())) == 5


def test_a_frame_is_reached_by_way_of_the_landmark_that_looks_most_like_it() -> None:
    luma = np.stack([shifted(amount) for amount in (0.0, 6.0, 12.0)])
    flows = np.zeros((3, HEIGHT, WIDTH, 2), np.float16)
    flows[1, ..., 0], flows[2, ..., 0] = 6, 12
    known = Landmarks(luma, np.array([[0], [6], [12]], np.float32), flows, 0)
    inside = np.s_[12:-12, 12:-30]
    flow = known.flow_to(shifted(13.0), np.array([11.0], np.float32))
    assert flow.dtype == np.float32
    assert np.median(off(flow, 13, inside)) < 0.15
    assert (flow[[0, -1]] == 0).all()
    np.testing.assert_allclose(
        known.flow_to(luma[1], np.array([6.0], np.float32))[inside], flows[1].astype(np.float32)[inside], atol=0.05
    )


def test_flow_falls_to_zero_at_the_edge() -> None:
    taper = edge_taper(WIDTH, HEIGHT)
    assert taper.shape == (HEIGHT, WIDTH)
    assert (taper[[0, -1]] == 0).all()
    assert (taper[:, [0, -1]] == 0).all()
    assert (taper[EDGE:-EDGE, EDGE:-EDGE] == 1).all()
    assert (np.diff(taper[HEIGHT // 2, : EDGE + 1]) > 0).all()
    np.testing.assert_array_equal(taper, taper[::-1, ::-1])
    found = chain(np.stack([shifted(0), shifted(2)]), np.array([[0], [1]], np.float32), 0)
    assert (found.flows[1][[0, -1]] == 0).all()
