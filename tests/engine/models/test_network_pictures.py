from __future__ import annotations

import numpy as np
import pytest
from tiny_pack import tiny_modes

from app.engine.models import network_pictures
from app.engine.models.model import Spoken
from app.engine.models.network_pictures import Pictures, learn_pictures
from app.engine.models.network_training import seen_error_and_slope
from app.engine.modes import draw_crop
from app.speech import Phone

SCALE = np.array([3.0, 2.0, 20.0, 10.0, 5.0], np.float32)
STANDARD = np.zeros(5, np.float32), SCALE


@pytest.fixture(scope="module")
def pictures() -> Pictures:
    rows = (np.random.default_rng(2).standard_normal((400, 5)) * SCALE).astype(np.float32)
    spoken = Spoken((Phone("AA", 0, 16),), rows, np.ones(400, bool))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(network_pictures, "DRAWN", 2000)
        patched.setattr(network_pictures, "ANALYSED", 500)
        patched.setattr(network_pictures, "EVENNESS", 1.0)  # as pixels count
        return learn_pictures([spoken], STANDARD, tiny_modes(), 0)


def test_what_looks_different_is_told_from_what_does_not(pictures: Pictures) -> None:
    """Distances of mouths it has not seen go with those of their drawn pictures."""
    random = np.random.default_rng(5)
    x = random.standard_normal((60, 5)).astype(np.float32)
    drawn = np.stack([draw_crop(tiny_modes(), row * SCALE).luma.ravel() for row in x])
    shown = pictures.components(x)[0] * np.sqrt(pictures.importance)
    pairs = random.integers(60, size=(2, 300))
    true, found = (((each[pairs[0]] - each[pairs[1]]) ** 2).sum(1) for each in (drawn, shown))
    assert np.corrcoef(np.sqrt(true), np.sqrt(found))[0, 1] > 0.85


def test_gradients_are_those_of_finite_differences(pictures: Pictures) -> None:
    random = np.random.default_rng(3)
    exact = Pictures({name: each.astype(np.float64) for name, each in pictures.weights.items()}, pictures.importance)  # type: ignore[misc]
    said, wanted = random.standard_normal((2, 2, 6, 5))
    counted = (random.random((2, 6, 1)) > 0.3).astype(float)
    _, slope = seen_error_and_slope(said, wanted, counted, 0.5, exact)  # type: ignore[arg-type]
    for _ in range(10):
        at = tuple(random.integers(size) for size in said.shape)
        step = np.zeros_like(said)
        step[at] = 1e-5
        above, below = (
            seen_error_and_slope(said + sign * step, wanted, counted, 0.5, exact)[0]  # type: ignore[arg-type]
            for sign in (1, -1)
        )
        assert slope[at] == pytest.approx((above - below) / 2e-5, rel=1e-3, abs=1e-6)


def test_what_is_seen_more_counts_more(pictures: Pictures) -> None:
    assert pictures.seen.mean() == pytest.approx(1, abs=1e-5)
    assert pictures.seen[2] > pictures.seen[4]  # a texture mode that varies four times as much
