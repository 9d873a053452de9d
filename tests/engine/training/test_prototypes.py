from __future__ import annotations

import numpy as np
import pytest

from app.engine.training.prototypes import choose_prototypes, choose_reference


@pytest.fixture
def space() -> np.ndarray:
    """Five clouds of twenty frames each, far apart, in mixed order."""
    random = np.random.default_rng(0)
    centres = 50 * np.eye(5)
    points = np.concatenate([centre + random.standard_normal((20, 5)) for centre in centres])
    return points[random.permutation(100)].astype(np.float32)


def test_prototypes_are_real_frames_one_of_each_kind(space: np.ndarray) -> None:
    chosen = choose_prototypes(space, 5, seed=0)
    assert chosen == sorted(set(chosen))
    assert all(isinstance(frame, int) and 0 <= frame < 100 for frame in chosen)
    assert sorted(space[chosen].argmax(1)) == [0, 1, 2, 3, 4]


def test_each_prototype_is_the_frame_nearest_to_its_cloud(space: np.ndarray) -> None:
    kind = space.argmax(1)
    for frame in choose_prototypes(space, 5, seed=0):
        cloud = np.flatnonzero(kind == kind[frame])
        distance = ((space[cloud] - space[cloud].mean(0)) ** 2).sum(1)
        assert cloud[distance.argmin()] == frame


def test_the_same_seed_chooses_the_same(space: np.ndarray) -> None:
    assert choose_prototypes(space, 12, seed=3) == choose_prototypes(space, 12, seed=3)


def test_few_frames_are_all_prototypes(space: np.ndarray) -> None:
    assert choose_prototypes(space[:7], 46, seed=0) == list(range(7))


def test_the_reference_is_the_prototype_farthest_from_rest() -> None:
    space = np.array([[0, 0], [1, 0], [5, 0], [9, 9], [2, 2]], np.float32)
    assert choose_reference(space, [1, 2, 4], rest=0) == 2
    assert choose_reference(space, [0, 1, 2, 3], rest=0) == 3
