from __future__ import annotations

import numpy as np
import pytest

from app.engine.models.network_layers import PAST, Adam, backward, forward, random_weights
from app.engine.models.network_training import error_and_slope

FEATURES, HIDDEN, OUT = 7, 6, 3


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(1)


def test_gradients_are_those_of_finite_differences(random: np.random.Generator) -> None:
    weights = {name: each.astype(np.float64) for name, each in random_weights(FEATURES, HIDDEN, OUT, random).items()}
    for name in ("b0", "b1", "b2", "b"):
        weights[name] = random.standard_normal(weights[name].shape)
    x, wanted = random.standard_normal((2, 12, FEATURES)), random.standard_normal((2, 12, OUT))
    counted = (random.random((2, 12, 1)) > 0.3).astype(float)

    def error() -> float:
        dropped = forward(weights, x, drop=0.3, random=np.random.default_rng(3))  # type: ignore[arg-type]
        return error_and_slope(dropped.out, wanted, counted, 0.5)[0]  # type: ignore[arg-type]

    done = forward(weights, x, drop=0.3, random=np.random.default_rng(3))  # type: ignore[arg-type]
    found = backward(weights, done, error_and_slope(done.out, wanted, counted, 0.5)[1])  # type: ignore[arg-type]
    assert set(found) == set(weights)
    for name, each in weights.items():
        for _ in range(5):
            at = tuple(random.integers(size) for size in each.shape)
            before, step = each[at], 1e-6
            each[at] = before + step
            above = error()
            each[at] = before - step
            below = error()
            each[at] = before
            assert found[name][at] == pytest.approx((above - below) / (2 * step), rel=1e-4, abs=1e-7), name


def test_nothing_later_and_nothing_much_earlier_matters(random: np.random.Generator) -> None:
    weights = random_weights(FEATURES, 32, OUT, random)
    x = random.standard_normal((1, 30, FEATURES)).astype(np.float32)
    changed = x.copy()
    changed[:, 12] += 1
    moved = np.abs(forward(weights, x).out - forward(weights, changed).out).max((0, 2))
    assert np.flatnonzero(moved).tolist() == list(range(12, 12 + PAST + 1))


def test_adam_finds_the_least_squares_solution(random: np.random.Generator) -> None:
    x, true = random.standard_normal((200, 4)).astype(np.float32), random.standard_normal((4, 2)).astype(np.float32)
    weights = {"w": np.zeros((4, 2), np.float32)}
    optimiser = Adam(weights, 0.0)
    for step in range(300):
        optimiser.step(weights, {"w": x.T @ (x @ weights["w"] - x @ true) / 200}, 0.1 * (1 - step / 300))
    np.testing.assert_allclose(weights["w"], true, atol=1e-3)
