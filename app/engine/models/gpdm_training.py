"""Training of one shared Gaussian-process dynamical model (Deena 2010, 2.1.1 and 4.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.engine.models.gpdm_optimiser import minimise
from app.engine.models.gpdm_process import Kernel, covariance, inverse, slope

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LATENT = 6
"""Dimensions of the latent space (4.1)."""
DYNAMICS = Kernel(radial=1.0, inverse_width=0.2, linear=0.02, noise=0.01)
"""Fixed: the signal-to-noise ratio is 100 : 1 (4.1); the latent points have about unit variance."""
FIRST = Kernel(radial=0.5, inverse_width=0.2, linear=0.1, noise=0.5)
"""Where the kernels of both observation spaces begin; outputs have unit variance."""
LOOSENESS = 1.0
"""Deviation of the logarithm of each of the kernel's numbers from where it begins, as far as we know beforehand: few
frames cannot tell them."""
FARTHEST = 16.0
"""Logarithm of a kernel's number, up or down, behind which nothing is looked for."""
PRIOR_FRAMES = 5.0
"""Frames that the prior of each output's scale, W of eq. 5, counts as."""


@dataclass(frozen=True)
class Trained:
    """One state's model.

    Attributes:
        points: (n, LATENT).
        sound, sight: kernels of the two observation spaces.
        sound_scale, sight_scale: (D,) diagonals of W_Y and W_Z of eq. 5.
        cost: negative logarithm of eq. 4, without constants.
    """

    points: Array
    sound: Kernel
    sight: Kernel
    sound_scale: Array
    sight_scale: Array
    cost: float


def principal_points(sound: Array, sight: Array, *, rng: np.random.Generator) -> Array:
    """Where latent points begin: principal components of each space, averaged (4.1).

    Components have unit variance, and as their signs mean nothing, those of sight are turned to agree with sound's.
    Where there are fewer components than dimensions, points differ by a little noise.

    Args:
        sound: (n, D) outputs, centred.
        sight: (n, E).
        rng: of the noise.
    """
    first, second = _components(sound), _components(sight)
    agree = np.where((first * second).sum(0) < 0, -1.0, 1.0)
    return (first + agree * second) / 2 + 1e-3 * rng.standard_normal(first.shape)


def _components(outputs: Array) -> Array:
    left, size, _ = np.linalg.svd(outputs - outputs.mean(0), full_matrices=False)
    count = min(LATENT, int((size > 1e-9 * max(size[0], 1e-300)).sum()))
    signs = np.where(left[np.abs(left).argmax(0), np.arange(left.shape[1])] < 0, -1.0, 1.0)
    found = np.zeros((len(outputs), LATENT))
    found[:, :count] = (left * signs)[:, :count] * np.sqrt(len(outputs))
    return found


@dataclass(frozen=True)
class Likelihood:
    """Eq. 4 of one state, to be maximised over latent points and kernels.

    Attributes:
        sound: (n, D) outputs, centred.
        sight: (n, E).
        before, after: (m,) rows of frames that follow each other within a sequence: X_in and X_out of eq. 7.
        first: (k,) rows that begin a sequence.
    """

    sound: Array
    sight: Array
    before: Index
    after: Index
    first: Index

    def __call__(self, variables: Array) -> tuple[float, Array]:
        """Negative logarithm of eq. 4 and its gradient.

        The scales W are always at their best for the rest (`best_scale`), so that they need no gradient.

        Args:
            variables: latent points (n, LATENT) row by row, then the logarithms of sound's and of sight's kernel.
        """
        points = variables[:-8].reshape(len(self.sound), LATENT)
        if np.abs(variables[-8:]).max() > FARTHEST:
            raise np.linalg.LinAlgError("a kernel is out of range")
        cost = 0.0
        moved = np.zeros_like(points)
        logarithms = np.zeros(8)
        for at, outputs in ((0, self.sound), (4, self.sight)):
            own = variables[-8:][at : at + 4]
            kernel = Kernel(*np.exp(own))
            whole, radial = covariance(kernel, points)
            precision, determinant = inverse(whole)
            solved = precision @ outputs
            power = (outputs * solved).sum(0)
            count = len(outputs) + PRIOR_FRAMES
            cost += 0.5 * outputs.shape[1] * determinant + 0.5 * count * float(np.log(power + PRIOR_FRAMES).sum())
            by = 0.5 * (outputs.shape[1] * precision - (solved * (count / (power + PRIOR_FRAMES))) @ solved.T)
            there = slope(kernel, points, radial, by)
            moved += there.points
            away = (own - np.log(FIRST)) / LOOSENESS
            cost += 0.5 * float(away @ away)
            logarithms[at : at + 4] = there.kernel + away / LOOSENESS
        cost += 0.5 * float((points[self.first] ** 2).sum())
        np.add.at(moved, self.first, points[self.first])
        if len(self.before):
            inputs, outputs = points[self.before], points[self.after]
            whole, radial = covariance(DYNAMICS, inputs)
            precision, determinant = inverse(whole)
            solved = precision @ outputs
            cost += 0.5 * LATENT * determinant + 0.5 * float((outputs * solved).sum())
            by = 0.5 * (LATENT * precision - solved @ solved.T)
            np.add.at(moved, self.before, slope(DYNAMICS, inputs, radial, by).points)
            np.add.at(moved, self.after, solved)
        return cost, np.concatenate([moved.ravel(), logarithms])


def best_scale(kernel: Kernel, points: Array, outputs: Array) -> Array:
    """(D,) diagonal of W in eq. 5 at its most probable, with a prior of scale 1 that counts as `PRIOR_FRAMES`."""
    precision, _ = inverse(covariance(kernel, points)[0])
    power = (outputs * (precision @ outputs)).sum(0)
    return np.asarray(np.sqrt((len(outputs) + PRIOR_FRAMES) / (power + PRIOR_FRAMES)))


def train(likelihood: Likelihood, *, steps: int, rng: np.random.Generator) -> Trained:
    """Maximise eq. 4 by scaled conjugate gradients from a start by principal components.

    Args:
        likelihood: of a state's frames.
        steps: of the optimiser, at most.
        rng: see `principal_points`.
    """
    start = principal_points(likelihood.sound, likelihood.sight, rng=rng)
    variables = np.concatenate([start.ravel(), np.log(FIRST), np.log(FIRST)])
    found, cost = minimise(likelihood, variables, steps=steps, enough=1e-3)
    points = found[:-8].reshape(start.shape)
    sound, sight = Kernel(*np.exp(found[-8:-4])), Kernel(*np.exp(found[-4:]))
    return Trained(
        points, sound, sight, best_scale(sound, points, likelihood.sound), best_scale(sight, points, likelihood.sight),
        cost,
    )  # fmt: skip
