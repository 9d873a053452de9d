"""One switching state at work: latent points from what is heard, and mouths from latent points (Deena 2010, 4.2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.engine.models.gpdm_optimiser import minimise
from app.engine.models.gpdm_process import Posterior
from app.engine.models.gpdm_training import DYNAMICS, LATENT, Trained

Array = NDArray[np.float64]

STEPS = 20
"""Of the optimiser for one stretch, at most."""
ENOUGH = 1e-3
LEAST_SPREAD = 0.05
"""Variance of latent points that begin a sequence, at least (eq. 12)."""


@dataclass(frozen=True)
class Space:
    """One observation space: outputs are scaled by W and seen from their mean.

    Attributes:
        process: from latent points to scaled outputs.
        centre: (D,) mean of the outputs.
        scale: (D,) diagonal of W.
    """

    process: Posterior
    centre: Array
    scale: Array

    def scaled(self, outputs: Array) -> Array:
        """As the process knows them."""
        return (outputs - self.centre) * self.scale

    def mean(self, points: Array) -> Array:
        """(m, D) outputs at latent points: eq. 14."""
        return self.process.mean(points) / self.scale + self.centre


def surprise(process: Posterior, points: Array, outputs: Array, more: float = 0.0) -> tuple[float, Array, Array]:
    """-log p(outputs | points) without constants, with its derivatives by points (m, q) and outputs (m, D).

    Args:
        process: that says the outputs.
        points: (m, q).
        outputs: (m, D), scaled.
        more: variance, if the outputs are further off than the process knows.
    """
    said = process.at(points)
    variance = said.variance + more
    missed = outputs - said.mean
    squared = (missed * missed).sum(1)
    count = outputs.shape[1]
    cost = 0.5 * float((count * np.log(variance) + squared / variance).sum())
    by_outputs = missed / variance[:, None]
    by_variance = 0.5 * (count - squared / variance) / variance
    return cost, said.back(-by_outputs, by_variance), by_outputs


@dataclass(frozen=True)
class State:
    """A trained model and its states of synthesis.

    Attributes:
        points: (n, LATENT) latent points of its training frames.
        heard: (n, D) what was heard there.
        sound, sight: the observation spaces.
        dynamics: from a latent point to the next; None if no training sequence has two frames.
        first, spread: (LATENT,) mean and variance of the points that begin a sequence (eq. 12).
    """

    points: Array
    heard: Array
    sound: Space
    sight: Space
    dynamics: Posterior | None
    first: Array
    spread: Array
    motion: float

    @staticmethod
    def of(trained: Trained, heard: Array, seen: Array, begins: NDArray[np.bool_]) -> State:
        """From a trained model and its frames.

        Args:
            trained: the model.
            heard, seen: (n, D) and (n, E) outputs, not centred.
            begins: (n,) rows that begin a sequence.
        """
        points = trained.points
        spaces = []
        for kernel, scale, outputs in (
            (trained.sound, trained.sound_scale, heard), (trained.sight, trained.sight_scale, seen),
        ):  # fmt: skip
            centre = outputs.mean(0)
            spaces.append(Space(Posterior.of(kernel, points, (outputs - centre) * scale), centre, scale))
        after = np.flatnonzero(~begins)
        dynamics = Posterior.of(DYNAMICS, points[after - 1], points[after]) if len(after) else None
        starts = points[begins]
        moved = np.diff(seen, axis=0)[~begins[1:]] * trained.sight_scale
        motion = float(np.mean(moved**2)) if len(moved) else 1.0
        return State(
            points, heard, spaces[0], spaces[1], dynamics, starts.mean(0), np.maximum(starts.var(0), LEAST_SPREAD),
            motion,
        )  # fmt: skip

    def optimised(self, heard: Array | None, frames: int, last: Array | None) -> Array:
        """Latent points of a stretch by algorithm 1: a point or a sequence, optimised as a whole.

        Args:
            heard: (m, D); None: nothing is known of the sound.
            frames: m.
            last: (E,) the mouth in front, which the first point shall explain too (4.2.3); None: there is none.

        Returns:
            (m, LATENT).
        """
        start = self._start(heard, frames)
        objective = Stretched(self, heard, last)
        return minimise(objective, start.ravel(), steps=STEPS, enough=ENOUGH)[0].reshape(frames, LATENT)

    def predicted(self, heard: Array | None, frames: int, last: Array | None) -> Array:
        """The same by algorithm 2: only the first point is optimised, the dynamics say the others."""
        points = np.empty((frames, LATENT))
        points[:1] = self.optimised(None if heard is None else heard[:1], 1, last)
        for frame in range(1, frames):
            here = points[frame - 1 : frame]
            points[frame] = here if self.dynamics is None else self.dynamics.mean(here)
        return points

    def _start(self, heard: Array | None, frames: int) -> Array:
        """Nearest training frames by what is heard (4.2.2); without sound what the dynamics say."""
        if heard is not None:
            near = (self.heard**2).sum(1) - 2.0 * (heard @ self.heard.T)
            return np.asarray(self.points[near.argmin(1)])
        points = np.empty((frames, LATENT))
        points[0] = self.first
        for frame in range(1, frames):
            here = points[frame - 1 : frame]
            points[frame] = here if self.dynamics is None else self.dynamics.mean(here)
        return points


@dataclass(frozen=True)
class Stretched:
    """Eq. 1 or 2 of algorithm 1, negative logarithm, with the term of 4.2.3."""

    state: State
    heard: Array | None
    last: Array | None

    def __call__(self, variables: Array) -> tuple[float, Array]:
        """Value and gradient at latent points (m, LATENT), row by row."""
        state = self.state
        points = variables.reshape(-1, LATENT)
        away = points[0] - state.first
        cost = 0.5 * float((away * away / state.spread).sum())
        moved = np.zeros_like(points)
        moved[0] = away / state.spread
        if self.heard is not None:
            more, by, _ = surprise(state.sound.process, points, state.sound.scaled(self.heard))
            cost, moved = cost + more, moved + by
        if state.dynamics is not None and len(points) > 1:
            more, by_before, by_after = surprise(state.dynamics, points[:-1], points[1:])
            cost += more
            moved[:-1] += by_before
            moved[1:] += by_after
        if self.last is not None:
            more, by, _ = surprise(state.sight.process, points[:1], state.sight.scaled(self.last[None]), state.motion)
            cost += more
            moved[:1] += by
        return cost, moved.ravel()
