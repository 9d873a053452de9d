from __future__ import annotations

import cv2
import numpy as np
import pytest

from app.engine.background import Box
from app.engine.evaluation.nose import nose_motion, nose_patch, shifts


def patch() -> np.ndarray:
    noise = np.random.default_rng(0).uniform(60, 200, (40, 50)).astype(np.float32)
    return cv2.GaussianBlur(noise, (0, 0), 3)


def moved(by: np.ndarray) -> np.ndarray:
    warp = np.array([[1, 0, by[0]], [0, 1, by[1]]])
    return cv2.warpAffine(patch(), warp, (50, 40), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def test_shifts_are_found_whatever_the_light() -> None:
    random = np.random.default_rng(1)
    true = random.uniform(-0.8, 0.8, (12, 2))
    true -= true.mean(0)
    pictures = np.stack([random.uniform(0.9, 1.1) * moved(by) + random.uniform(-9, 9) for by in true])
    assert np.abs(shifts(pictures.astype(np.float32)) - true).max() < 0.08


def test_what_stands_still_does_not_move() -> None:
    found = nose_motion([shifts(np.stack([patch()] * 3))])
    assert (found.p95, found.across, found.down) == (pytest.approx(0, abs=1e-6),) * 3
    assert found.frames == 3


def test_motion_is_summed_up_over_clips() -> None:
    found = nose_motion([np.array([[3.0, 4.0]]), np.array([[3.0, 4.0]])])
    assert (found.p95, found.across, found.down, found.frames) == (5, 3, 4, 2)


def test_the_patch_is_above_the_mouth_and_in_the_crop() -> None:
    rows, columns = nose_patch(Box(0, 0, 98, 84), 136.6)
    assert 0 <= rows.start < rows.stop < 42 - 10
    assert (columns.start + columns.stop) // 2 == 49
