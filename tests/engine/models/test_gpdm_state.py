from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import approx_fprime

from app.engine.models.gpdm_state import State, Stretched
from app.engine.models.gpdm_training import FIRST, LATENT, Likelihood, Trained, best_scale, train

Array = NDArray[np.float64]
BEGINS = np.arange(24) % 6 == 0


@pytest.fixture(scope="module")
def frames() -> tuple[Array, Array]:
    """Four sequences of six frames: two circles, heard and seen through different mixtures."""
    rng = np.random.default_rng(0)
    angle = np.tile(np.arange(6) * 0.6, 4) + np.repeat(rng.standard_normal(4) * 0.2, 6)
    hidden = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    heard, seen = (hidden @ rng.standard_normal((2, size)) + 3 for size in (5, 7))
    return heard + 0.01 * rng.standard_normal(heard.shape), seen + 0.01 * rng.standard_normal(seen.shape)


@pytest.fixture(scope="module")
def state(frames: tuple[Array, Array]) -> State:
    heard, seen = frames
    after = np.flatnonzero(~BEGINS)
    centred = heard - heard.mean(0), seen - seen.mean(0)
    likelihood = Likelihood(*centred, after - 1, after, np.flatnonzero(BEGINS))
    return State.of(train(likelihood, steps=30, rng=np.random.default_rng(0)), heard, seen, BEGINS)


@pytest.mark.parametrize("heard", [True, False])
@pytest.mark.parametrize("last", [True, False])
@pytest.mark.parametrize("count", [1, 3])
def test_what_is_optimised_has_the_gradient_of_finite_differences(
    state: State, frames: tuple[Array, Array], heard: bool, last: bool, count: int
) -> None:
    at = np.random.default_rng(2).standard_normal(count * LATENT)
    objective = Stretched(state, frames[0][:count] if heard else None, frames[1][7] if last else None)
    numeric = approx_fprime(at, lambda x: objective(x)[0], 1e-7)
    np.testing.assert_allclose(objective(at)[1], numeric, rtol=1e-3, atol=2e-3)


@pytest.mark.parametrize("infer", ["optimised", "predicted"])
def test_a_sequence_that_is_heard_is_seen(state: State, frames: tuple[Array, Array], infer: str) -> None:
    heard, seen = (rows[6:12] for rows in frames)
    shown = state.sight.mean(getattr(state, infer)(heard, 6, None))
    assert np.abs(shown - seen).mean() < 0.3 * np.abs(seen - frames[1].mean(0)).mean()


def test_the_dynamics_alone_say_all_but_the_first(state: State, frames: tuple[Array, Array]) -> None:
    points = state.predicted(frames[0][6:12], 6, None)
    assert state.dynamics is not None
    np.testing.assert_allclose(points[1:], state.dynamics.mean(points[:-1]), atol=1e-12)
    np.testing.assert_array_equal(points[:1], state.optimised(frames[0][6:7], 1, None))


def test_the_mouth_in_front_draws_the_first_towards_it(state: State, frames: tuple[Array, Array]) -> None:
    last = frames[1][9]
    free = state.sight.mean(state.optimised(frames[0][6:8], 2, None))[0]
    drawn = state.sight.mean(state.optimised(frames[0][6:8], 2, last))[0]
    assert np.linalg.norm(drawn - last) < np.linalg.norm(free - last)


def test_sequences_of_one_frame_stay_where_they_are() -> None:
    rng = np.random.default_rng(3)
    heard, seen, points = rng.standard_normal((9, 5)), rng.standard_normal((9, 7)), rng.standard_normal((9, LATENT))
    scales = best_scale(FIRST, points, heard), best_scale(FIRST, points, seen)
    state = State.of(Trained(points, FIRST, FIRST, *scales, 0.0), heard, seen, np.ones(9, bool))
    found = state.predicted(heard[:3], 3, None)
    assert state.dynamics is None
    assert np.array_equal(found, np.tile(found[:1], (3, 1)))
    assert np.isfinite(state.optimised(None, 3, seen[0])).all()
