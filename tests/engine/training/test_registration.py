from __future__ import annotations

import cv2
import numpy as np
import pytest
from filmed import speaking
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from app.engine.background import Box
from app.engine.frame import from_rgb
from app.engine.training.layout import face_mask
from app.engine.training.registration import LEAST_RESTED, MOST_SHIFT, UNCORRECTED, Correction, register

WIDTH, HEIGHT = 116, 100
SIDE = 161.0
CROP = Box(102, 152, WIDTH, HEIGHT)
SIZE = WIDTH * HEIGHT
MASK = face_mask(CROP, SIDE)
Array = NDArray[np.float64]


def mouth() -> NDArray[np.uint8]:
    """(P,) planes of Mary's mouth at rest."""
    rgb = speaking()[0][CROP.y : CROP.y + HEIGHT, CROP.x : CROP.x + WIDTH]
    return from_rgb(np.ascontiguousarray(rgb)).reshape(-1)


def changed(
    flat: NDArray[np.uint8], warp: Array, gain: float = 1, bias: float = 0, tint: tuple[float, float] = (0, 0)
) -> NDArray[np.uint8]:
    """A passage's mouth: what is at p in the common crop is at warp(p) in it, in other light; by scipy's splines."""
    luma = flat[:SIZE].reshape(HEIGHT, WIDTH).astype(np.float64)
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    back = np.linalg.inv(np.vstack([warp, [0, 0, 1]]))
    u, v = back[0, 0] * x + back[0, 1] * y + back[0, 2], back[1, 0] * x + back[1, 1] * y + back[1, 2]
    shown = map_coordinates(luma, [v, u], order=3, mode="nearest") * gain + bias
    chroma = flat[SIZE:].reshape(2, -1) + np.array(tint)[:, None]
    return np.clip(np.rint(np.concatenate([shown.ravel(), chroma.ravel()])), 0, 255).astype(np.uint8)


def affine(numbers: list[float]) -> Array:
    """Shift, and stretch and shear about the middle."""
    x, y, a, b, c, d = numbers
    linear = np.array([[1 + a, b], [c, 1 + d]])
    middle = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
    return np.hstack([linear, (np.array([x, y]) + middle - linear @ middle)[:, None]])


def distance(one: Array, other: Array) -> float:
    """Largest within the mask's inner part."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    points = np.stack([x[MASK > 0.5], y[MASK > 0.5], np.ones((MASK > 0.5).sum())])
    return float(np.linalg.norm((one - other) @ points, axis=0).max())


shifts = st.floats(-3, 3)
stretches = st.floats(-0.04, 0.04)


@given(
    numbers=st.tuples(shifts, shifts, stretches, stretches, stretches, stretches).map(list), gain=st.floats(0.85, 1.15),
    bias=st.floats(-12, 12), tint=st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
)  # fmt: skip
@settings(max_examples=30, deadline=None)
def test_a_known_difference_to_the_common_mouth_is_found_and_undone(
    numbers: list[float], gain: float, bias: float, tint: tuple[float, float]
) -> None:
    common, warp = mouth(), affine(numbers)
    passage = changed(common, warp, gain, bias, tint)
    (found,), given_back = register(passage[None], np.array([9]), MASK, common=common.astype(np.float32))
    np.testing.assert_array_equal(given_back, common)
    assert distance(found.warp, warp) < 0.2
    assert found.gain == pytest.approx(gain, abs=0.02)
    assert found.bias == pytest.approx(bias, abs=4.0)  # what gain and bias share
    assert found.tint == pytest.approx(tint, abs=0.7)
    # undone, it is the common mouth
    luma = passage[:SIZE].reshape(HEIGHT, WIDTH)
    back = cv2.warpAffine(luma, found.warp, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    undone = found.undo(np.concatenate([back.ravel(), passage[SIZE:]]).astype(np.uint8), SIZE)
    inner = MASK.ravel() > 0.5
    before, after = (
        float(np.sqrt(np.mean((seen[:SIZE][inner].astype(float) - common[:SIZE][inner]) ** 2)))
        for seen in (passage, undone)
    )
    assert after < 1.2 or after < before / 5


def test_passages_are_registered_to_their_mean() -> None:
    random = np.random.default_rng(0)
    warps = [affine([*random.uniform(-2, 2, 2), *random.uniform(-0.02, 0.02, 4)]) for _ in range(8)]
    gains, biases = random.uniform(0.93, 1.07, 8), random.uniform(-6, 6, 8)
    tints = random.uniform(-3, 3, (8, 2))
    rest = np.stack(
        [changed(mouth(), *each) for each in zip(warps, gains, biases, tints.tolist(), strict=True)]
    )  # fmt: skip
    corrections, common = register(rest, np.full(8, 5), MASK)
    # the common crop may lie anywhere between: what counts is that all agree on where
    to_common = [
        np.linalg.inv(np.vstack([warp, [0, 0, 1]])) @ np.vstack([each.warp, [0, 0, 1]])
        for warp, each in zip(warps, corrections, strict=True)
    ]
    for one in to_common[1:]:
        assert distance(one[:2], to_common[0][:2]) < 0.25
    assert distance(np.mean(to_common, 0)[:2], np.eye(3)[:2]) < 2
    ratio = np.array([each.gain for each in corrections]) / gains
    assert np.ptp(ratio) < 0.02
    measured = np.array([each.tint for each in corrections])
    np.testing.assert_allclose(measured - measured.mean(0), tints - tints.mean(0), atol=0.6)
    np.testing.assert_allclose(measured.mean(0), 0, atol=1e-6)
    assert common.shape == rest[0].shape


def test_equal_passages_need_no_correction() -> None:
    rest = np.stack([mouth()] * 3)
    corrections, common = register(rest, np.array([5, 5, 5]), MASK)
    for each in corrections:
        assert distance(each.warp, UNCORRECTED.warp) < 1e-3
        assert (each.gain, each.bias, *each.tint) == pytest.approx((1, 0, 0, 0), abs=1e-3)
    np.testing.assert_allclose(common, mouth(), atol=0.01)


def test_a_passage_that_hardly_rested_is_left_alone() -> None:
    other = changed(mouth(), affine([3, 0, 0, 0, 0, 0]))
    rest = np.stack([mouth(), mouth(), other])
    corrections, common = register(rest, np.array([5, 5, LEAST_RESTED - 1]), MASK)
    assert corrections[2] is UNCORRECTED
    np.testing.assert_allclose(common, mouth(), atol=0.01)


def test_if_nobody_rested_nothing_is_corrected() -> None:
    rest = np.stack([mouth()] * 2)
    corrections, common = register(rest, np.array([0, 2]), MASK)
    assert corrections == [UNCORRECTED] * 2
    assert not common.any()
    kept = mouth().astype(np.float32)
    assert register(rest, np.array([0, 0]), MASK, common=kept)[1] is kept


def odd_ones() -> dict[str, NDArray[np.uint8]]:
    random = np.random.default_rng(1)
    grey = np.full(mouth().shape, 128, np.uint8)
    return {
        "shifted": changed(mouth(), affine([2 * MOST_SHIFT * WIDTH, 0, 0, 0, 0, 0])),
        "stretched": changed(mouth(), affine([0, 0, 0.25, 0, 0, 0.25])),
        "noise": random.integers(0, 256, mouth().shape, np.uint8),
        "grey": grey,
        "black": np.zeros_like(grey),
        "negative": (255 - mouth()).astype(np.uint8),
        "dark": changed(mouth(), UNCORRECTED.warp, gain=0.05, bias=10),
    }


@pytest.mark.parametrize("name", list(odd_ones()))
def test_what_no_correction_can_mend_is_ignored(name: str) -> None:
    """And does not spoil the others."""
    odd = odd_ones()[name]
    alone, kept = register(odd[None], np.array([5]), MASK, common=mouth().astype(np.float32))
    assert alone[0] is UNCORRECTED
    np.testing.assert_array_equal(kept, mouth())
    rest = np.stack([mouth(), changed(mouth(), affine([1, 0.5, 0, 0, 0, 0])), odd, mouth(), mouth()])
    corrections, common = register(rest, np.full(5, 5), MASK)
    assert corrections[2] is UNCORRECTED
    assert np.isfinite(common).all()
    shift = corrections[1].warp[:, 2] - corrections[0].warp[:, 2]
    np.testing.assert_allclose(shift, [1, 0.5], atol=0.15)
    inner = MASK.ravel() > 0.5
    assert np.abs(common[:SIZE][inner] - mouth()[:SIZE][inner]).mean() < 3


@given(
    gain=st.floats(0.7, 1.4), bias=st.floats(-15, 15), tint=st.tuples(st.floats(-10, 10), st.floats(-10, 10)),
    seed=st.integers(0, 99),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_light_is_undone_within_rounding(gain: float, bias: float, tint: tuple[float, float], seed: int) -> None:
    flat = np.random.default_rng(seed).integers(60, 150, (3, 60), np.uint8)
    lit = flat.astype(np.float64)
    lit[:, :40] = lit[:, :40] * gain + bias
    lit[:, 40:50] += tint[0]
    lit[:, 50:] += tint[1]
    undone = Correction(UNCORRECTED.warp, gain, bias, tint).undo(np.rint(lit).astype(np.uint8), 40)
    assert undone.dtype == np.uint8
    assert np.abs(undone.astype(float) - flat)[:, :40].max() <= 0.5 + 0.5 / gain + 1e-9
    assert np.abs(undone.astype(float) - flat)[:, 40:].max() <= 1
    one = Correction(UNCORRECTED.warp, gain, bias, tint).undo(np.rint(lit[0]).astype(np.uint8), 40)
    np.testing.assert_array_equal(one, undone[0])


def test_undoing_nothing_changes_nothing() -> None:
    flat = np.arange(256, dtype=np.uint8)[None, :252]
    np.testing.assert_array_equal(UNCORRECTED.undo(flat, 168), flat)


def test_light_beyond_the_range_is_clipped() -> None:
    flat = np.array([0, 255, 255, 0, 255, 0], np.uint8)
    np.testing.assert_array_equal(
        Correction(UNCORRECTED.warp, 0.5, 20, (-9, 9)).undo(flat, 4), [0, 255, 255, 0, 255, 0]
    )
