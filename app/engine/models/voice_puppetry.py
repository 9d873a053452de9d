"""Voice Puppetry (Brand 1999) as Deena 2010 compares with: a hidden Markov model of the mouth, heard through its sound.

A Markov model is learnt from mouths and their velocities, with Brand's entropic prior on its transitions. Each state is
then given the sounds that occurred with it. To speak, the states are found in the sound, and the mouths are those that
are the most likely under the states' positions and velocities. Brand takes the one most probable path of states; here
every state counts by its probability, which is better throughout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.engine.models.model import Input
from app.engine.models.sound import Sound
from app.speech import Phone

Array = NDArray[np.float64]
Float = NDArray[np.float32]

FLOOR = 0.02
"""Least variance of a state, where the whole recording has 1."""


LEAST_COUNT = 1e-9
"""Of transitions; fewer are none."""


@dataclass(frozen=True)
class Gaussians:
    """Of each of S states, diagonal.

    Attributes:
        mean, variance: (S, D).
    """

    mean: Array
    variance: Array

    def log_likelihood(self, rows: Array) -> Array:
        """(T, S) of rows (T, D)."""
        precision = 1.0 / self.variance
        squared = (rows**2) @ precision.T - 2.0 * rows @ (self.mean * precision).T + (self.mean**2 * precision).sum(1)
        return np.asarray(-0.5 * (squared + np.log(2.0 * np.pi * self.variance).sum(1)))

    @staticmethod
    def of(rows: Array, share: Array) -> Gaussians:
        """Those that fit rows (F, D) with shares (F, S) best, variances not below `FLOOR`."""
        weight = np.maximum(share.sum(0), 1e-9)[:, None]
        mean = share.T @ rows / weight
        variance = share.T @ rows**2 / weight - mean**2
        return Gaussians(mean, np.maximum(variance, FLOOR))


def with_velocity(rows: Array) -> Array:
    """(T, 2 D): rows, and how they differ from those before; the first does not move."""
    return np.concatenate([rows, np.diff(rows, axis=0, prepend=rows[:1])], axis=1)


def entropic(counts: Array) -> Array:
    """Probabilities that rows of counts make most likely under Brand's prior exp(-entropy).

    They maximise sum (n + p) log p, so that n / p + log p is one number -u for all of a row: p is -n / W(-n exp(u))
    with the lower branch of Lambert's W, and u is found by bisection. Where the counts of a row are too few for that
    branch, they are taken as they are; where there are none, all are alike.

    Args:
        counts: (R, S), at least 0.

    Returns:
        (R, S), rows sum to 1.
    """
    total = counts.sum(1, keepdims=True)
    plain = np.where(total > LEAST_COUNT, counts / np.maximum(total, LEAST_COUNT), 1.0 / counts.shape[1])
    there = counts > LEAST_COUNT
    logarithm = np.log(np.where(there, counts, 1.0))

    def given(offset: Array) -> Array:
        return np.where(there, counts / _lower_branch(-(logarithm + offset)), 0.0)

    low = -4.0 * total - 100.0
    high = -np.where(there, logarithm, -np.inf).max(1, initial=-1e3, keepdims=True) - 1.0
    fits = given(high).sum(1, keepdims=True) >= 1.0
    for _ in range(60):
        middle = (low + high) / 2
        less = given(middle).sum(1, keepdims=True) < 1.0
        low, high = np.where(less, middle, low), np.where(less, high, middle)
    found = given(high)
    return np.asarray(np.where(fits, found / np.maximum(found.sum(1, keepdims=True), 1e-300), plain))


def _lower_branch(u: Array) -> Array:
    """t = -W(-exp(-u)), at least 1, for u of at least 1: the root of t - log t = u, by Newton from above."""
    beyond = np.maximum(u - 1.0, 0.0)
    t = 1.0 + np.sqrt(2.0 * beyond) + beyond
    for _ in range(8):
        t = np.maximum(t - (t - np.log(t) - u) / np.maximum(1.0 - 1.0 / t, 1e-9), 1.0)
    return np.asarray(t)


def forward_backward(initial: Array, transitions: Array, log_likelihood: Array) -> tuple[Array, Array, float]:
    """Posterior of the states, expected transitions, log probability of the rows.

    Args:
        initial: (S,) probabilities.
        transitions: (S, S), rows sum to 1.
        log_likelihood: (T, S).

    Returns:
        (T, S), (S, S) summed over time, and a number.
    """
    frames, states = log_likelihood.shape
    peak = log_likelihood.max(1)
    likely = np.exp(log_likelihood - peak[:, None]) + 1e-300
    forward = np.empty((frames, states))
    scale = np.empty(frames)
    for frame in range(frames):
        here = (initial if frame == 0 else forward[frame - 1] @ transitions) * likely[frame]
        scale[frame] = max(here.sum(), 1e-300)
        forward[frame] = here / scale[frame]
    backward = np.ones((frames, states))
    for frame in range(frames - 2, -1, -1):
        backward[frame] = transitions @ (likely[frame + 1] * backward[frame + 1]) / scale[frame + 1]
    share = forward * backward
    share /= np.maximum(share.sum(1, keepdims=True), 1e-300)
    weighted = likely[1:] * backward[1:] / scale[1:, None]
    return share, transitions * (forward[:-1].T @ weighted), float((np.log(scale) + peak).sum())


@dataclass(frozen=True)
class VoicePuppetry:
    """States of the mouth and how they sound.

    Attributes:
        initial, transitions: (S,) and (S, S) probabilities.
        sight: over mouths and their velocities, (S, 2 K), in standard deviations.
        sound: over MFCC and their differences, (S, 40), in standard deviations.
        seen: (2, K) what was taken off mouths, and by what they were divided.
        heard: (2, 20) the same for MFCC.
        rest: (K,) the mouth at rest.
        fps: frames a second.
    """

    initial: Array
    transitions: Array
    sight: Gaussians
    sound: Gaussians
    seen: Float
    heard: Float
    rest: Float
    fps: float

    name = "voice-puppetry"
    inputs: frozenset[Input] = frozenset({"sound"})

    def predict(
        self, phones: Sequence[Phone], frames: int, *, before: Float | None = None, sound: Sound | None = None
    ) -> Float:
        """See `app.engine.models.model.TrajectoryModel`; phones do not matter, without sound the mouth rests."""
        del phones
        if sound is None or not frames:
            return np.tile(self.rest, (frames, 1))
        heard = with_velocity((sound.frames(frames, self.fps) - self.heard[0]) / self.heard[1].astype(np.float64))
        share, _, _ = forward_backward(self.initial, self.transitions, self.sound.log_likelihood(heard))
        last = None
        if before is not None and len(before):
            last = (before[-1].astype(np.float64) - self.seen[0]) / self.seen[1]
        rows = trajectory(self.sight, share, last)
        return np.asarray(rows * self.seen[1] + self.seen[0], np.float32)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """See `app.engine.models.model.TrajectoryModel`."""
        return {
            "initial": self.initial, "transitions": self.transitions,
            "sight_mean": self.sight.mean, "sight_variance": self.sight.variance,
            "sound_mean": self.sound.mean, "sound_variance": self.sound.variance,
            "seen": self.seen, "heard": self.heard, "rest": self.rest, "fps": np.array([self.fps]),
        }  # fmt: skip


def trajectory(sight: Gaussians, share: Array, last: Array | None) -> Array:
    """The most likely mouths (T, K) under Gaussians of position and velocity: a tridiagonal solve, O(T).

    Minimises the expected squared distance, each state counting by its share. The first frame has no velocity unless
    there is a frame in front.

    Args:
        sight: (S, 2 K).
        share: (T, S) of the states in each frame.
        last: (K,) the frame in front; None: there is none.
    """
    size = sight.mean.shape[1] // 2
    precision = share @ (1.0 / sight.variance)
    target = share @ (sight.mean / sight.variance)
    place, pull = precision[:, :size], target[:, :size]
    drag, push = precision[:, size:].copy(), target[:, size:].copy()
    if last is None:
        drag[0], push[0] = 0.0, 0.0
    diagonal = place + drag
    diagonal[:-1] += drag[1:]
    right = pull + push
    right[:-1] -= push[1:]
    if last is not None:
        right[0] += drag[0] * last
    # Thomas's algorithm, all coefficients side by side.
    for frame in range(1, len(right)):
        ratio = drag[frame] / diagonal[frame - 1]
        diagonal[frame] -= ratio * drag[frame]
        right[frame] += ratio * right[frame - 1]
    right[-1] /= diagonal[-1]
    for frame in range(len(right) - 2, -1, -1):
        right[frame] = (right[frame] + drag[frame + 1] * right[frame + 1]) / diagonal[frame]
    return right
