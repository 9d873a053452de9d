"""Training of the trajectory model: statistics a state, then gradient descent on what is actually shown (Ezzat 2002).

Means and variances of the frames a phone covers make speech under-articulated: smoothing pulls every target towards
its neighbours. So (mu, Sigma) are then trained until the *smoothed* trajectories match the analysed ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.engine.models.model import Spoken
from app.engine.states import VISEMES, Occupancy, occupancy, parent, plain, segments, viseme
from app.engine.trajectory import GaussianTrajectory
from app.errors import TrainingFailed
from app.speech import SILENCE

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Options:
    """How a trajectory model is trained. Shrinkage is in frames: how many frames of a prior each statistic is worth."""

    smoothness: float = 1.0
    order: int = 2
    lead: float = 0.04
    cap: float = 12.0
    mean_shrinkage: float = 3.0
    context_shrinkage: float = 10.0
    variance_shrinkage: float = 5.0
    variance_floor: float = 0.02
    epochs: int = 40
    rate: float = 0.015
    pull: float = 2e-4  # towards the statistics, per frame
    contexts: bool = True  # halves of phones beside their neighbours; else one Gaussian a phone, as Fu 2011 has it
    seed: int = 0


@dataclass(frozen=True)
class Target:
    """A stretch as training sees it: states, standardised coefficients (T, K), and which frames count (T, 1)."""

    shown: Occupancy
    target: Array
    counted: Array


def fit_trajectory(
    spoken: Sequence[Spoken],
    rest: NDArray[np.float32],
    *,
    fps: float,
    options: Options,
    progress: Callable[[float], None] = lambda _: None,
) -> GaussianTrajectory:
    """Train on stretches of speech.

    Args:
        spoken: to train on.
        rest: (K,) coefficients of the mouth at rest: silence far from speech is set to it and not trained.
        fps: frames a second.
        options: see `Options`.
        progress: told the share done.
    """
    model = untrained(spoken, rest, fps=fps, options=options)
    for epoch, trained in enumerate(descent(model, spoken, options), 1):
        progress(epoch / options.epochs)
        model = trained
    return model


def untrained(
    spoken: Sequence[Spoken], rest: NDArray[np.float32], *, fps: float, options: Options
) -> GaussianTrajectory:
    """The model of plain statistics: eq. 3.2 with the mean and variance of every state. See `fit_trajectory`.

    Raises:
        TrainingFailed: no frame that counts shows speech.
    """
    used = np.concatenate([each.coefficients[each.counted] for each in spoken]).astype(np.float64)
    offset, scale = used.mean(0), np.maximum(used.std(0), 1e-6)
    sequences = [segments(each.phones) for each in spoken]
    if not options.contexts:
        sequences = [[replace(each, state=plain(each.state)) for each in sequence] for sequence in sequences]
    shown_states = {segment.state for sequence in sequences for segment in sequence}
    everything = sorted(shown_states | {parent(state) for state in shown_states} | {SILENCE})
    names = {state: index for index, state in enumerate(everything)}
    seen = np.zeros(len(names), bool)
    for sequence, each in zip(sequences, spoken, strict=True):
        shown = occupancy(sequence, names, len(each.counted), fps=fps, lead=options.lead, cap=options.cap)
        share = shown.share * each.counted[:, None]
        seen[shown.states[share > 0]] = True
    for state in everything:
        if seen[names[state]]:
            seen[names[parent(state)]] = True  # what unseen neighbours fall back to
    seen[names[SILENCE]] = True
    states = tuple(state for state in everything if seen[names[state]])
    if all(state.startswith(SILENCE) for state in states):  # such a model could not say a word
        raise TrainingFailed("nothing is said in the pictures that can be learnt from")
    count = len(states), len(offset)
    model = GaussianTrajectory(
        states, np.zeros(count), np.ones(count), offset, scale, fps, options.smoothness, options.order, options.lead,
        options.cap,
    )  # fmt: skip
    mean, variance = state_statistics(targets(model, spoken), states, options)
    silence = states.index(SILENCE)
    mean[silence] = (rest - offset) / scale
    variance[silence] = options.variance_floor
    return replace(model, mean=mean, precision=1 / variance)


def targets(model: GaussianTrajectory, spoken: Sequence[Spoken]) -> list[Target]:
    """Stretches of speech in a model's states and standard coefficients."""
    return [
        Target(
            model.occupancy(each.phones, len(each.counted)),
            (each.coefficients.astype(np.float64) - model.offset) / model.scale,
            each.counted[:, None].astype(np.float64),
        )
        for each in spoken
    ]


def state_statistics(passages: Sequence[Target], states: Sequence[str], options: Options) -> tuple[Array, Array]:
    """Mean and variance (P, K) of every state.

    Those of a state beside some viseme are shrunk towards those of the state whatever is beside it, these towards the
    viseme's, and those towards the whole recording's.
    """
    target = np.concatenate([passage.target for passage in passages])
    share = np.zeros((len(target), len(states)))
    row = 0
    for passage in passages:
        frames = np.arange(row, row + len(passage.target))
        for slot in range(passage.shown.share.shape[1]):
            counted = passage.shown.share[:, slot] * passage.counted[:, 0]
            np.add.at(share, (frames, passage.shown.states[:, slot]), counted)
        row += len(passage.target)
    used = np.concatenate([passage.counted[:, 0] for passage in passages]) > 0
    overall = target[used].mean(0), target[used].var(0)
    to_parent = np.eye(len(states))[parents(states)]
    to_viseme = np.zeros((len(states), len(VISEMES)))
    to_viseme[np.arange(len(states)), [viseme(state) for state in states]] = 1
    looks = _shrunk(share @ to_viseme, target, overall, 2.0, 5.0)
    prior = to_viseme @ looks[0], to_viseme @ looks[1]
    wide = _shrunk(share @ to_parent, target, prior, options.mean_shrinkage, options.variance_shrinkage)
    prior = to_parent @ wide[0], to_parent @ wide[1]
    own = share * (parents(states) != np.arange(len(states)))  # a parent is its prior: all its frames are in it
    mean, variance = _shrunk(own, target, prior, options.context_shrinkage, options.context_shrinkage)
    return mean, np.maximum(variance, options.variance_floor)


def parents(states: Sequence[str]) -> NDArray[np.int64]:
    """(P,) index of each state's parent; its own if it is one."""
    names = {state: index for index, state in enumerate(states)}
    return np.array([names[parent(state)] for state in states])


def _shrunk(
    share: Array, target: Array, prior: tuple[Array, Array], mean_frames: float, variance_frames: float
) -> tuple[Array, Array]:
    count = share.sum(0)[:, None]
    total = share.T @ target
    mean = (total + mean_frames * prior[0]) / (count + mean_frames)
    scatter = share.T @ target**2 - 2 * mean * total + mean**2 * count
    return mean, (scatter + variance_frames * prior[1]) / (count + variance_frames)


def gradients(model: GaussianTrajectory, passage: Target) -> tuple[float, Array, Array]:
    """Half the squared error of a passage's smoothed trajectory, and its gradients in mean and log precision (P, K).

    With A y = D' P mu, A = D' P D + lambda R and A v = y - y*: dE/dmu = D' P v and dE/dlog P = D' P v (mu - y), summed
    over the frames of a state.
    """
    diagonal, right = model.targets(passage.shown)
    shown = model.smooth(diagonal, right)
    error = (shown - passage.target) * passage.counted
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


def descent(model: GaussianTrajectory, spoken: Sequence[Spoken], options: Options) -> Iterator[GaussianTrajectory]:
    """The model after each epoch of Adam on (mean, log precision), one stretch a step; silence stays.

    A state is its parent plus a difference, so that what is learnt in one context moves the others and what unseen
    contexts fall back to; differences are pulled to their start more than parents are.
    """
    passages = targets(model, spoken)
    frozen = model.states.index(SILENCE)
    family = parents(model.states)
    is_parent = (family == np.arange(len(family)))[:, None]
    start = np.stack([model.mean, np.log(model.precision)])
    change = np.zeros_like(start)  # of parents as they are, of children beyond their parents'
    first, second = np.zeros_like(change), np.zeros_like(change)
    step = 0
    random = np.random.default_rng(options.seed)
    for _ in range(options.epochs):
        for index in random.permutation(len(passages)):
            passage = passages[index]
            _, by_mean, by_precision = gradients(model, passage)
            slope = np.stack([by_mean, by_precision]) / len(passage.target)
            of_parents = np.zeros_like(slope)
            for sums, slopes in zip(of_parents, slope, strict=True):
                np.add.at(sums, family, slopes)
            slope = np.where(is_parent, of_parents, slope)
            slope += np.where(is_parent, 1, CHILD_PULL) * options.pull * change
            slope[:, frozen] = 0
            step += 1
            first = 0.9 * first + 0.1 * slope
            second = 0.999 * second + 0.001 * slope**2
            stride = first / (1 - 0.9**step) / (np.sqrt(second / (1 - 0.999**step)) + 1e-8)
            change = change - options.rate * stride
            current = start + change + np.where(is_parent, 0, change[:, family])
            model = replace(model, mean=current[0], precision=np.exp(current[1]))
        yield model


CHILD_PULL = 2.0
"""Times the pull of parents: contexts have fewer frames."""
