"""Trajectories of mouth coefficients from phones: Gaussians a state, smoothed (Fu 2011, 3.3.1; Ezzat 2002).

For every coefficient the trajectory y minimises (y - mu)' D' S^-1 D (y - mu) + lambda y' (W'W)^z y (eq. 3.1), that is,
it solves (D' S^-1 D + lambda (W'W)^z) y = D' S^-1 D mu (eq. 3.2). A frame that shows several states has one target
term for each, weighted by its share of the frame.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.engine.banded import smoothness_band, solve
from app.engine.models.model import Input
from app.engine.models.sound import Sound
from app.engine.states import Occupancy, Segment, lookalikes, occupancy, parent, segments
from app.speech import SILENCE, Phone

Array = NDArray[np.float64]
Coefficients = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class GaussianTrajectory:
    """A diagonal Gaussian for every state, in standardised coefficients.

    Attributes:
        states: names, in the order of the rows below (`app.engine.states.segments` makes them).
        mean: (P, K), float64.
        precision: (P, K), float64, positive: the inverse variances.
        offset: (K,), what a standardised coefficient of zero means.
        scale: (K,), what one means more than zero.
        fps: frames a second that the smoothness was trained for.
        smoothness: lambda of eq. 3.1 at `fps`, for standardised coefficients. (Fu 2011 sets 1000 with z = 4 for raw
            coefficients at 29.97 fps; on standardised ones that smooths speech away.)
        order: z of eq. 3.1.
        lead: seconds by which the lips are ahead of the sound.
        cap: frames; longer segments weigh no less than this.
    """

    states: tuple[str, ...]
    mean: Array
    precision: Array
    offset: Array
    scale: Array
    fps: float = 25.0
    smoothness: float = 2.0
    order: int = 2
    lead: float = 0.05
    cap: float = 12.0

    @property
    def name(self) -> str:
        """Of its kind."""
        return "gaussian"

    @property
    def inputs(self) -> frozenset[Input]:
        """What it can speak from."""
        return frozenset({"phones"})

    def predict(
        self,
        phones: Sequence[Phone],
        frames: int,
        *,
        before: Coefficients | None = None,
        sound: Sound | None = None,
    ) -> Coefficients:
        """Coefficients of every frame of some phones.

        Args:
            phones: gapless; frame n shows time n / fps of them. None at all are silence.
            frames: T; before the first phone and after the last, these two go on.
            before: (b, K) coefficients of the frames just before; the trajectory continues them smoothly. Only the
                last `order` matter.
            sound: does not matter.

        Returns:
            (T, K), float32.
        """
        del sound
        if frames <= 0:
            return np.zeros((0, len(self.scale)), np.float32)
        shown = self.occupancy(phones or [Phone(SILENCE, 0.0, frames / self.fps)], frames)
        diagonal, right = self.targets(shown)
        standard = self.smooth(diagonal, right, before=self._standardise(before))
        return (standard * self.scale + self.offset).astype(np.float32)

    def occupancy(self, phones: Sequence[Phone], frames: int) -> Occupancy:
        """States and shares of every frame (`app.engine.states.occupancy`), untrained states replaced."""
        names = {name: index for index, name in enumerate(self.states)}
        sequence = [_known(segment, names) for segment in segments(phones)]
        return occupancy(sequence, names, frames, fps=self.fps, lead=self.lead, cap=self.cap)

    def targets(self, shown: Occupancy) -> tuple[Array, Array]:
        """Diagonal of D' S^-1 D and right-hand side D' S^-1 D mu of eq. 3.2, both (T, K)."""
        diagonal = np.zeros((len(shown.share), self.mean.shape[1]))
        right = np.zeros_like(diagonal)
        weighted_mean = self.precision * self.mean
        for slot in range(shown.share.shape[1]):
            weight = (shown.share[:, slot] / shown.duration[:, slot])[:, None]
            if not weight.any():
                break
            state = shown.states[:, slot]
            diagonal += weight * self.precision[state]
            right += weight * weighted_mean[state]
        return diagonal, right

    def smooth(self, diagonal: Array, right: Array, *, before: Array | None = None) -> Array:
        """Solve eq. 3.2 for standardised coefficients, (T, K); `before` (b, K) are fixed neighbours in front."""
        frames = len(right)
        fixed = None if before is None or not len(before) else before[-self.order :]
        count = 0 if fixed is None else len(fixed)
        band = self.smoothness * smoothness_band(frames + count, self.order)
        if fixed is not None:
            right = right.copy()
            for row in range(min(self.order, frames)):  # move the known columns to the right-hand side
                for known in range(count):
                    distance = count + row - known
                    if distance <= self.order:
                        right[row] -= band[distance, known] * fixed[known]
        solution = np.empty_like(right)
        solve(diagonal, np.ascontiguousarray(band[:, count:]), right, solution)
        return solution

    @property
    def rest(self) -> Coefficients:
        """(K,) the mouth in long silence."""
        mean: Coefficients = (self.mean[self.states.index(SILENCE)] * self.scale + self.offset).astype(np.float32)
        return mean

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """See `app.engine.models.model.TrajectoryModel`; read again by `app.engine.models.gaussian.load_gaussian`."""
        return {
            "states": np.array(self.states),
            "state_mean": self.mean,
            "state_precision": self.precision,
            "coefficient_offset": self.offset,
            "coefficient_scale": self.scale,
            "trajectory": np.array([self.fps, self.smoothness, self.order, self.lead, self.cap]),
        }

    def _standardise(self, coefficients: Coefficients | None) -> Array | None:
        return None if coefficients is None else (coefficients.astype(np.float64) - self.offset) / self.scale


def _known(segment: Segment, trained: Collection[str]) -> Segment:
    state = nearest_state(segment.state, trained)
    return segment if state == segment.state else replace(segment, state=state)


def nearest_state(state: str, trained: Collection[str]) -> str:
    """The state itself if it was trained, else what stands in for it.

    First the same half of the phone whatever is beside it, then its nearest viseme's; never silence for speech.
    """
    if state in trained:
        return state
    if parent(state) in trained:
        return parent(state)
    phone, _, part = parent(state).partition(".")
    if phone == SILENCE:
        return SILENCE
    for candidate in lookalikes(phone):
        for name in (f"{candidate}.{part}", candidate, f"{candidate}.0", f"{candidate}.1"):
            if name in trained:
                return name
    return next(name for name in sorted(trained) if not name.startswith(SILENCE))
