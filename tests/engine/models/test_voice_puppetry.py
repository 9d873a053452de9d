from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import norm
from talking import FPS, REST, talk, talked
from threadpoolctl import threadpool_limits

from app.engine.models.registry import fit
from app.engine.models.voice_puppetry import (
    FLOOR,
    Gaussians,
    VoicePuppetry,
    entropic,
    forward_backward,
    trajectory,
    with_velocity,
)
from app.engine.models.voice_puppetry_training import VoicePuppetryKind
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack

Array = NDArray[np.float64]
NEW = talk("SIL", "B", "AA", "S", "S", "AA", "B", "SIL", seed=99)


@pytest.mark.parametrize("counts", [[5.0, 3.0, 1.5], [400.0, 30.0, 0.02], [9000.0, 1.0], [2.0, 2.0]])
def test_entropic_probabilities_are_the_most_likely(counts: list[float]) -> None:
    known = np.array(counts)
    found = entropic(known[None])[0]

    def cost(logits: Array) -> float:
        p = np.exp(logits - logits.max())
        p /= p.sum()
        return -float(((known + p) * np.log(p)).sum())

    best = minimize(cost, np.log(known), method="BFGS", options={"gtol": 1e-8})
    assert found.sum() == pytest.approx(1)
    assert cost(np.log(found)) <= best.fun + 1e-6 * abs(best.fun)


def test_entropic_probabilities_are_surer_than_frequencies() -> None:
    counts = np.array([6.0, 3.0, 0.0])
    found = entropic(counts[None])[0]
    assert found[0] > 2 / 3
    assert found[2] == 0
    rows = entropic(np.array([[0.0, 3.0], [0.2, 0.1], [0.0, 0.0]]))
    np.testing.assert_allclose(rows, [[0, 1], [2 / 3, 1 / 3], [0.5, 0.5]])


def test_posteriors_are_those_of_all_paths() -> None:
    rng = np.random.default_rng(0)
    initial, transitions = rng.dirichlet(np.ones(3)), rng.dirichlet(np.ones(3), 3)
    likely = rng.standard_normal((4, 3)) * 2 - 800
    share, steps, total = forward_backward(initial, transitions, likely)
    expected, moves, weights = np.zeros((4, 3)), np.zeros((3, 3)), []
    paths = list(product(range(3), repeat=4))
    for path in paths:
        logs = np.log(initial[path[0]]) + sum(np.log(transitions[a, b]) for a, b in pairwise(path))
        weights.append(logs + sum(likely[frame, state] for frame, state in enumerate(path)))
    chance = np.exp(np.array(weights) - max(weights))
    for path, each in zip(paths, chance / chance.sum(), strict=True):
        for frame, state in enumerate(path):
            expected[frame, state] += each
        for a, b in pairwise(path):
            moves[a, b] += each
    np.testing.assert_allclose(share, expected, atol=1e-10)
    np.testing.assert_allclose(steps, moves, atol=1e-10)
    assert total == pytest.approx(max(weights) + np.log(chance.sum()))


def test_gaussians_are_those_of_scipy() -> None:
    rng = np.random.default_rng(1)
    found = Gaussians(rng.standard_normal((2, 3)), rng.uniform(0.5, 2, (2, 3)))
    rows = rng.standard_normal((4, 3))
    expected = norm.logpdf(rows[:, None], found.mean, np.sqrt(found.variance)).sum(2)
    np.testing.assert_allclose(found.log_likelihood(rows), expected)
    share = np.array([[1.0, 0], [1, 0], [0, 1], [0, 1]])
    fitted = Gaussians.of(rows, share)
    np.testing.assert_allclose(fitted.mean[0], rows[:2].mean(0))
    np.testing.assert_allclose(fitted.variance[1], np.maximum(rows[2:].var(0), FLOOR))


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("frames", [1, 2, 9])
def test_the_trajectory_is_that_of_a_dense_least_squares(held: bool, frames: int) -> None:
    rng = np.random.default_rng(2)
    sight = Gaussians(rng.standard_normal((3, 4)), rng.uniform(0.2, 2, (3, 4)))
    share = rng.dirichlet(np.ones(3), frames)
    last = np.array([2.0, -1.0]) if held else None
    found = trajectory(sight, share, last)
    for k in range(2):
        rows, right = [], []
        for frame, state in product(range(frames), range(3)):
            for column, place in ((k, True), (2 + k, False)):
                weight = np.sqrt(share[frame, state] / sight.variance[state, column])
                row, value = np.zeros(frames), sight.mean[state, column]
                row[frame] = 1
                if not place and frame:
                    row[frame - 1] = -1
                elif not place and last is not None:
                    value += last[k]
                elif not place:
                    continue
                rows.append(weight * row)
                right.append(weight * value)
        np.testing.assert_allclose(found[:, k], np.linalg.lstsq(np.array(rows), np.array(right))[0], atol=1e-9)


def test_velocity_is_the_difference_to_the_frame_before() -> None:
    assert with_velocity(np.array([[1.0], [3.0], [2.0]])).tolist() == [[1, 0], [3, 2], [2, -1]]


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """As the service has it: threads inside such small products cost far more than they save."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="module")
def model() -> VoicePuppetry:
    found = fit("voice-puppetry", talked(8), REST, fps=FPS)
    assert isinstance(found, VoicePuppetry)
    return found


def test_mouths_are_heard(model: VoicePuppetry) -> None:
    rows = model.predict((), len(NEW.counted), sound=NEW.sound)
    assert rows.dtype == np.float32
    spread = ((NEW.coefficients - NEW.coefficients.mean(0)) ** 2).mean()
    assert ((rows - NEW.coefficients) ** 2).mean() < 0.3 * spread


def test_without_sound_it_rests(model: VoicePuppetry) -> None:
    assert np.array_equal(model.predict(NEW.phones, 3), np.tile(REST, (3, 1)))
    assert model.predict(NEW.phones, 0, sound=NEW.sound).shape == (0, 3)


def test_what_was_before_goes_on_without_a_jump(model: VoicePuppetry) -> None:
    whole = model.predict((), 40, sound=NEW.sound)
    before = whole[:1] + 3
    rows = model.predict((), 40, sound=NEW.sound, before=before)
    assert np.linalg.norm(rows[0] - before) < np.linalg.norm(whole[0] - before)
    np.testing.assert_allclose(rows[-5:], whole[-5:], atol=0.1)


def test_it_is_read_as_it_was_stored(model: VoicePuppetry) -> None:
    again = VoicePuppetryKind().load(StoredArrays("a file", model.to_arrays()))
    assert np.array_equal(*(each.predict((), 40, sound=NEW.sound) for each in (model, again)))


@pytest.mark.parametrize("name", ["transitions", "sight_variance", "heard"])
def test_arrays_that_are_none_of_its_own_are_refused(model: VoicePuppetry, name: str) -> None:
    arrays = model.to_arrays()
    with pytest.raises(BadPack):
        VoicePuppetryKind().load(StoredArrays("a file", arrays | {name: -arrays[name]}))


def test_the_same_seed_gives_the_same_model(model: VoicePuppetry) -> None:
    again = fit("voice-puppetry", talked(8), REST, fps=FPS).to_arrays()
    assert all(np.array_equal(array, again[name]) for name, array in model.to_arrays().items())
