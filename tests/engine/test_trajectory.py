from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine.avatar import Avatar
from app.engine.states import segments
from app.engine.trajectory import GaussianTrajectory, nearest_state
from app.speech import PHONES, SILENCE, Phone

Array = NDArray[np.float64]
Phones = tuple[Phone, ...]


def dense(model: GaussianTrajectory, phones: Phones, frames: int) -> tuple[Array, Array, Array]:
    """Eq. 3.1 written out: the diagonal of D' S^-1 D, (T, K), D' S^-1 D mu, (T, K), and lambda (W'W)^z, (T, T).

    A frame that shows several states has a target term for each, weighted by its share of the frame's time.
    """
    weight, target = np.zeros((frames, len(model.offset))), np.zeros((frames, len(model.offset)))
    sequence = segments(phones)
    for number, segment in enumerate(sequence):
        start = -np.inf if number == 0 else segment.start
        end = np.inf if number == len(sequence) - 1 else segment.end
        row = model.states.index(nearest_state(segment.state, model.states))
        duration = min(model.cap, max(0.5, (segment.end - segment.start) * model.fps))
        seen = np.arange(frames) / model.fps + model.lead
        share = np.minimum(end, seen + 0.5 / model.fps) - np.maximum(start, seen - 0.5 / model.fps)
        d = np.sqrt(np.maximum(share, 0) * model.fps / duration)[:, None]
        weight += d * model.precision[row] * d
        target += d * model.precision[row] * d * model.mean[row]
    w = np.zeros((max(frames - 1, 0), frames))
    w[np.arange(frames - 1), np.arange(frames - 1)] = -1
    w[np.arange(frames - 1), np.arange(1, frames)] = 1
    return weight, target, model.smoothness * np.linalg.matrix_power(w.T @ w, model.order)


def solved(model: GaussianTrajectory, phones: Phones, frames: int) -> Array:
    """Eq. 3.2 by dense matrices, in the model's own coefficients."""
    weight, target, smooth = dense(model, phones, frames)
    columns = [np.linalg.solve(np.diag(weight[:, k]) + smooth, target[:, k]) for k in range(weight.shape[1])]
    return np.stack(columns, 1) * model.scale + model.offset


def assert_close(found: NDArray[np.float32], expected: Array) -> None:
    worst = np.abs(found - expected).max(0) / np.abs(expected).max(0)
    assert worst.max() < 1e-6, worst


@pytest.mark.parametrize("frames", [1, 2, 3, 17, 300])
def test_marys_trajectories_solve_the_equation(mary: Avatar, phones: Phones, frames: int) -> None:
    model = mary.pack.trajectory
    found = model.predict(phones, frames)
    assert found.shape == (frames, len(mary.rest))
    assert found.dtype == np.float32
    assert_close(found, solved(model, phones, frames))


@pytest.mark.parametrize(("order", "smoothness"), [(1, 0.3), (3, 5.0), (4, 1000.0)])
def test_other_settings_solve_it_too(mary: Avatar, phones: Phones, order: int, smoothness: float) -> None:
    model = replace(mary.pack.trajectory, order=order, smoothness=smoothness)  # (4, 1000) are those of Fu 2011
    assert_close(model.predict(phones, 120), solved(model, phones, 120))


@given(st.lists(st.tuples(st.sampled_from(PHONES), st.floats(0.025, 0.4)), min_size=1, max_size=12), st.integers(1, 60))
@settings(max_examples=30, deadline=None)
def test_any_phones_solve_it_even_untrained_ones(tiny_words: list[tuple[str, float]], frames: int) -> None:
    edges = np.concatenate([[0], np.cumsum([length for _, length in tiny_words])])
    spoken = tuple(Phone(word[0], float(edges[i]), float(edges[i + 1])) for i, word in enumerate(tiny_words))
    model = small()
    assert_close(model.predict(spoken, frames), solved(model, spoken, frames))


def small(order: int = 2) -> GaussianTrajectory:
    random = np.random.default_rng(0)
    return GaussianTrajectory(
        ("AA", "M", SILENCE), random.standard_normal((3, 4)), random.uniform(0.3, 5, (3, 4)),
        random.standard_normal(4), random.uniform(0.5, 3, 4), order=order,
    )  # fmt: skip


def test_a_long_speech_needs_no_square_matrix(mary: Avatar, phones: Phones) -> None:
    mary.trajectory(phones, 4)
    tracemalloc.start()
    try:
        mary.trajectory(phones, 4000)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 64 * 2**20, "one 4000 x 4000 matrix would be 122 MB"


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("known", [1, 2, 3, 8])
def test_frames_before_are_a_condition_of_the_dense_system(order: int, known: int) -> None:
    # The system of (the last `order` of) the known frames and the new ones, with the known values put in.
    model = small(order)
    spoken = (Phone("AA", 0, 0.3), Phone("M", 0.3, 0.5), Phone("AA", 0.5, 0.7))
    before = np.random.default_rng(known).standard_normal((known, 4)).astype(np.float32)
    found = model.predict(spoken, 20, before=before)
    weight, target, _ = dense(model, spoken, 20)
    fixed = (before.astype(np.float64) - model.offset) / model.scale
    for kept in {min(order, known), known} if known > order else {known}:
        smooth = dense(model, spoken, 20 + kept)[2]
        for k in range(4):
            right = target[:, k] - smooth[kept:, :kept] @ fixed[known - kept :, k]
            expected = np.linalg.solve(smooth[kept:, kept:] + np.diag(weight[:, k]), right)
            expected = expected * model.scale[k] + model.offset[k]
            np.testing.assert_allclose(found[:, k], expected, rtol=0, atol=2e-6 * np.abs(expected).max())


def test_no_frames_before_are_no_condition() -> None:
    model, spoken = small(), (Phone("AA", 0, 0.3), Phone(SILENCE, 0.3, 0.5))
    np.testing.assert_array_equal(
        model.predict(spoken, 9, before=np.zeros((0, 4), np.float32)), model.predict(spoken, 9)
    )
    assert model.predict(spoken, 0).shape == (0, 4)


@pytest.mark.parametrize("cut", [1, 2, 40, 90, 199])
def test_continuing_from_the_whole_solution_gives_the_rest_of_it(mary: Avatar, phones: Phones, cut: int) -> None:
    model = mary.pack.trajectory
    diagonal, right = model.targets(model.occupancy(phones, 200))
    whole = model.smooth(diagonal, right)
    rest = model.smooth(diagonal[cut:], right[cut:], before=whole[:cut])
    if cut >= model.order:
        np.testing.assert_allclose(rest, whole[cut:], atol=1e-9)
    else:  # with fewer known frames than `order` the system has another edge: still that of these frames alone
        np.testing.assert_allclose(rest, whole[cut:], atol=1e-6)


@pytest.mark.parametrize(("overlap", "bound"), [(10, 0.03), (25, 1e-4), (50, 1e-9)])
def test_a_window_that_looks_ahead_differs_little_from_the_whole(
    mary: Avatar, phones: Phones, overlap: int, bound: float
) -> None:
    """Windows of a second, each solved with so many frames beyond its end: within `bound` standard deviations."""
    model = mary.pack.trajectory
    frames = 700
    diagonal, right = model.targets(model.occupancy(phones, frames))
    whole = model.smooth(diagonal, right)
    parts: list[Array] = []
    for start in range(0, frames, 25):
        ahead = slice(start, min(frames, start + 25 + overlap))
        before = np.concatenate(parts)[-8:] if parts else None
        parts.append(model.smooth(diagonal[ahead], right[ahead], before=before)[:25])
    error = np.abs(np.concatenate(parts) - whole)
    assert error.max() < bound, error.max()
    assert np.abs(np.diff(np.concatenate(parts), axis=0)).max() < np.abs(np.diff(whole, axis=0)).max() * 1.05


def test_a_mouth_at_rest_stays_at_rest(mary: Avatar) -> None:
    before = np.repeat(mary.rest[None], 8, 0)
    shown = mary.trajectory([Phone(SILENCE, 0, 2)], 50, before=before)
    assert np.abs((shown - mary.rest) / mary.pack.trajectory.scale).max() < 1e-4


@pytest.mark.parametrize("bilabial", ["M", "B", "P"])
def test_two_and_a_half_frames_close_marys_lips_between_open_vowels(mary: Avatar, bilabial: str) -> None:
    spoken = [Phone("AA", 0, 0.3), Phone(bilabial, 0.3, 0.4), Phone("AA", 0.4, 0.7), Phone(SILENCE, 0.7, 1.5)]
    rows = mary.trajectory(spoken, 35)
    modes = mary.pack.modes
    middle = modes.layer.shape[1] // 2
    inside = np.flatnonzero(modes.layer[:, middle] == 0)  # of the mouth, between the lips

    def gap(coefficients: NDArray[np.float32]) -> float:
        down = modes.flow(coefficients)[:, middle, 1]
        return float(down[inside[-1] + 1] - down[inside[0] - 1])

    closed, vowel, during = gap(mary.rest), gap(rows[2]), min(gap(row) for row in rows[6:10])
    assert vowel > closed + 20
    assert during < closed + 1
    assert gap(rows[-1]) == pytest.approx(closed, abs=0.5)


SPEECH = sorted(set(PHONES) - {SILENCE})
ALL_STATES = [
    *(f"{phone}{half}" for phone in SPEECH for half in ("", ".0", ".1", ".0|P", ".1|AA", ".0|SIL")),
    *(f"SIL.{side}{step}{beside}" for side in ("after", "before") for step in range(4) for beside in ("", "|P")),
    SILENCE,
]  # fmt: skip


@pytest.mark.parametrize("phone", SPEECH)
def test_an_untrained_phone_is_never_silent(phone: str) -> None:
    for trained in (
        ("AA", "M", SILENCE),
        ("AA.0", "M.1|P", SILENCE, "SIL.after0"),
        ("K.0|SIL", "SIL.before0|K", SILENCE),
    ):
        for state in (phone, f"{phone}.0", f"{phone}.1", f"{phone}.0|P", f"{phone}.1|SIL"):
            assert nearest_state(state, trained) in set(trained) - {SILENCE, "SIL.after0", "SIL.before0|K"}


@given(st.sampled_from(ALL_STATES), st.sets(st.sampled_from(ALL_STATES)))
@settings(max_examples=300, deadline=None)
def test_what_stands_in_is_trained_and_as_near_as_it_can_be(state: str, others: set[str]) -> None:
    trained = {*others, SILENCE, "L.0"}
    found = nearest_state(state, trained)
    assert found in trained
    assert found.startswith(SILENCE) == state.startswith(SILENCE)
    whole = state.partition("|")[0]
    if state in trained:
        assert found == state
    elif whole in trained:
        assert found == whole
    elif state.startswith(SILENCE):
        assert found == SILENCE
    elif {whole.partition(".")[0] + half for half in ("", ".0", ".1")} & trained:
        assert found.partition(".")[0] == whole.partition(".")[0]


def test_untrained_phones_look_like_their_nearest() -> None:
    trained = ("AA", "AY.0", "AY.1", "M", "S.0", "S.1", "S.1|P", "UW", SILENCE, "SIL.after0", "SIL.after0|P")
    for state, found in {
        "P": "M", "B.0|AA": "M", "Z.1|T": "S.1", "W.0": "UW", "AO": "AA", "AW.0|SIL": "AA", "AY.1|K": "AY.1",
        "S.0|L": "S.0",
        "S.1|P": "S.1|P", "S.1|L": "S.1", "SIL.after0|AA": "SIL.after0", "SIL.after0|P": "SIL.after0|P",
        "SIL.before2|AA": SILENCE,
    }.items():  # fmt: skip
        assert nearest_state(state, trained) == found, state


def test_the_other_half_stands_in_before_another_phone_does() -> None:
    assert nearest_state("OW.1|P", ("OW.0", "AO.1", SILENCE)) == "OW.0"
    assert nearest_state("AO.1", ("OW.0", "OW.1", SILENCE)) == "OW.1"


def test_rest_is_the_mouth_of_long_silence() -> None:
    model = small()
    np.testing.assert_allclose(model.rest, model.mean[2] * model.scale + model.offset, rtol=1e-6)
