from __future__ import annotations

import numpy as np

from app.engine.models.hmm_rows import HEARD, ROWS, heard_rows, rows_of, seen_rows, with_dynamics
from app.engine.models.mfcc import COUNT, RATE, mfcc
from app.engine.models.sound import Sound

FPS = 25


def test_dynamics_of_a_parabola() -> None:
    t = np.arange(10.0)
    found = with_dynamics((3 + 2 * t + 0.5 * t**2)[:, None])
    np.testing.assert_allclose(found[1:-1, 1], 2 + t[1:-1])
    np.testing.assert_allclose(found[1:-1, 2], 1.0)


def test_frames_are_among_the_rows_and_between_them_it_is_smooth() -> None:
    t = np.arange(12.0)
    coefficients = np.stack([np.sin(t / 2), np.cos(t / 2)], 1)
    rows, sure = seen_rows(coefficients, np.ones(12, bool), 0, rows_of(12))
    assert rows.shape == (11 * ROWS + 1, 6)
    np.testing.assert_allclose(rows[::ROWS, :2], coefficients, atol=1e-9)
    finer = np.arange(rows_of(12)) / ROWS / 2
    inner = slice(2 * ROWS, -2 * ROWS)
    np.testing.assert_allclose(rows[inner, 0], np.sin(finer)[inner], atol=0.005)
    np.testing.assert_allclose(rows[inner, 2], (np.cos(finer) / 2 / ROWS)[inner], atol=0.002)
    assert sure[1:-1].all()


def test_rows_ahead_are_those_moved() -> None:
    coefficients = np.random.default_rng(0).standard_normal((8, 2))
    counted = np.ones(8, bool)
    still, _ = seen_rows(coefficients, counted, 0, 40)
    moved, sure = seen_rows(coefficients, counted, -4, 44)
    np.testing.assert_allclose(moved[5:], still[1:], atol=1e-12)
    assert not sure[:5].any()


def test_rows_beside_frames_that_do_not_count_are_not_sure() -> None:
    coefficients = np.random.default_rng(0).standard_normal((8, 1))
    counted = np.ones(8, bool)
    counted[3], coefficients[3] = False, np.nan
    rows, sure = seen_rows(coefficients, counted, 0, rows_of(8))
    assert np.isfinite(rows).all()
    assert np.flatnonzero(~sure[1:-1]).tolist() == list(range(2 * ROWS - 1, 4 * ROWS))


def test_one_frame_stands_still() -> None:
    rows, sure = seen_rows(np.array([[np.nan], [2.0], [np.nan]]), np.array([False, True, False]), 0, 17)
    assert (rows == [2.0, 0.0, 0.0]).all()
    assert not sure.any()


def test_sound_is_heard_at_its_rows() -> None:
    samples = np.random.default_rng(1).standard_normal(RATE).astype(np.float32)
    found = heard_rows(Sound(samples, RATE, start=-0.2), 3, 20, FPS)
    times = np.arange(2, 24) / (ROWS * FPS) + 0.2
    expected = mfcc(samples, times)
    assert found.shape == (20, HEARD)
    np.testing.assert_allclose(found[:, :COUNT], expected[1:-1], atol=1e-5)
    np.testing.assert_allclose(found[:, COUNT : 2 * COUNT], (expected[2:] - expected[:-2]) / 2, atol=1e-5)
