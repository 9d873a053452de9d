"""Training of the trajectory model: statistics a state, then gradient descent on what is actually shown (Ezzat 2002).

Means and variances of the frames a phone covers make speech under-articulated: smoothing pulls every target towards
its neighbours. So (mu, Sigma) are then trained until the *smoothed* trajectories match the analysed ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.engine.states import VISEMES, Occupancy, occupancy, segments, viseme
from app.engine.trajectory import GaussianTrajectory
from app.speech import SILENCE, Phone

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Options:
    """How a trajectory model is trained. Shrinkage is in frames: how many frames of a prior each statistic is worth."""

    smoothness: float = 2.0
    order: int = 2
    lead: float = 0.05
    cap: float = 12.0
    mean_shrinkage: float = 3.0
    variance_shrinkage: float = 5.0
    variance_floor: float = 0.02
    epochs: int = 40
    rate: float = 0.03
    pull: float = 5e-4  # towards the statistics, per frame
    seed: int = 0


@dataclass(frozen=True)
class Passage:
    """A stretch of the recording to train on: its states and its standardised coefficients (T, K)."""

    shown: Occupancy
    target: Array


def fit_trajectory(
    coefficients: NDArray[np.float32],
    phones: Sequence[Phone],
    spans: Sequence[range],
    rest: NDArray[np.float32],
    *,
    fps: float,
    options: Options,
    progress: Callable[[float], None] = lambda _: None,
) -> GaussianTrajectory:
    """Train on the given spans of a recording.

    Args:
        coefficients: (T, K) of all frames.
        phones: of the whole recording.
        spans: the frames to train on, a sentence each.
        rest: (K,) coefficients of the mouth at rest: silence far from speech is set to it and not trained.
        fps: frames a second.
        options: see `Options`.
        progress: told the share done.
    """
    used = np.concatenate([coefficients[list(span)] for span in spans]).astype(np.float64)
    offset, scale = used.mean(0), np.maximum(used.std(0), 1e-6)
    sequence = segments(phones)
    everything = {state: index for index, state in enumerate(sorted({s.state for s in sequence} | {SILENCE}))}
    shown = occupancy(sequence, everything, len(coefficients), fps=fps, lead=options.lead, cap=options.cap)
    seen = np.zeros(len(everything), bool)
    for span in spans:
        rows = list(span)
        seen[shown.states[rows][shown.share[rows] > 0]] = True
    seen[everything[SILENCE]] = True
    states = tuple(state for state, index in everything.items() if seen[index])
    renumber = np.cumsum(seen) - 1
    standard = (coefficients.astype(np.float64) - offset) / scale
    passages = [
        Passage(
            Occupancy(renumber[shown.states[list(span)]], shown.share[list(span)], shown.duration[list(span)]),
            standard[list(span)],
        )
        for span in spans
    ]
    mean, variance = state_statistics(passages, states, options)
    silence = states.index(SILENCE)
    mean[silence] = (rest - offset) / scale
    variance[silence] = options.variance_floor
    model = GaussianTrajectory(
        states, mean, 1 / variance, offset, scale, fps, options.smoothness, options.order, options.lead, options.cap
    )
    return descend(model, passages, options, frozen=silence, progress=progress)


def state_statistics(passages: Sequence[Passage], states: Sequence[str], options: Options) -> tuple[Array, Array]:
    """Mean and variance (P, K) of every state, shrunk towards its viseme's, and those towards the whole recording's."""
    target = np.concatenate([passage.target for passage in passages])
    share = np.zeros((len(target), len(states)))
    row = 0
    for passage in passages:
        frames = np.arange(row, row + len(passage.target))
        for slot in range(passage.shown.share.shape[1]):
            np.add.at(share, (frames, passage.shown.states[:, slot]), passage.shown.share[:, slot])
        row += len(passage.target)
    classes = np.zeros((len(states), len(VISEMES)))
    classes[np.arange(len(states)), [viseme(state) for state in states]] = 1
    overall = target.mean(0), target.var(0)
    shared = _shrunk(share @ classes, target, overall, 2.0, 5.0)
    prior = classes @ shared[0], classes @ shared[1]
    mean, variance = _shrunk(share, target, prior, options.mean_shrinkage, options.variance_shrinkage)
    return mean, np.maximum(variance, options.variance_floor)


def _shrunk(
    share: Array, target: Array, prior: tuple[Array, Array], mean_frames: float, variance_frames: float
) -> tuple[Array, Array]:
    count = share.sum(0)[:, None]
    total = share.T @ target
    mean = (total + mean_frames * prior[0]) / (count + mean_frames)
    scatter = share.T @ target**2 - 2 * mean * total + mean**2 * count
    return mean, (scatter + variance_frames * prior[1]) / (count + variance_frames)


def gradients(model: GaussianTrajectory, passage: Passage) -> tuple[float, Array, Array]:
    """Half the squared error of a passage's smoothed trajectory, and its gradients in mean and log precision (P, K).

    With A y = D' P mu, A = D' P D + lambda R and A v = y - y*: dE/dmu = D' P v and dE/dlog P = D' P v (mu - y), summed
    over the frames of a state.
    """
    diagonal, right = model.targets(passage.shown)
    shown = model.smooth(diagonal, right)
    error = shown - passage.target
    adjoint = model.smooth(diagonal, error)
    by_mean, by_precision = np.zeros_like(model.mean), np.zeros_like(model.mean)
    for slot in range(passage.shown.share.shape[1]):
        weight = (passage.shown.share[:, slot] / passage.shown.duration[:, slot])[:, None]
        if not weight.any():
            break
        state = passage.shown.states[:, slot]
        push = weight * model.precision[state] * adjoint
        np.add.at(by_mean, state, push)
        np.add.at(by_precision, state, push * (model.mean[state] - shown))
    return 0.5 * float((error**2).sum()), by_mean, by_precision


def descend(
    model: GaussianTrajectory,
    passages: Sequence[Passage],
    options: Options,
    *,
    frozen: int,
    progress: Callable[[float], None],
) -> GaussianTrajectory:
    """Adam on (mean, log precision), one passage a step; the state `frozen` stays."""
    start = np.stack([model.mean, np.log(model.precision)])
    current = start.copy()
    first, second = np.zeros_like(current), np.zeros_like(current)
    step = 0
    random = np.random.default_rng(options.seed)
    for epoch in range(options.epochs):
        progress(epoch / options.epochs)
        for index in random.permutation(len(passages)):
            passage = passages[index]
            _, by_mean, by_precision = gradients(replace(model, mean=current[0], precision=np.exp(current[1])), passage)
            slope = np.stack([by_mean, by_precision]) / len(passage.target) + options.pull * (current - start)
            slope[:, frozen] = 0
            step += 1
            first = 0.9 * first + 0.1 * slope
            second = 0.999 * second + 0.001 * slope**2
            stride = first / (1 - 0.9**step) / (np.sqrt(second / (1 - 0.999**step)) + 1e-8)
            current = current - options.rate * stride
    return replace(model, mean=current[0], precision=np.exp(current[1]))
