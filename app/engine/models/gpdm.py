"""Switching shared Gaussian-process dynamical models (Deena 2010): phones and sound to mouths, state by state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from app.engine.models.gpdm_corpus import pieces
from app.engine.models.gpdm_process import Kernel
from app.engine.models.gpdm_state import State
from app.engine.models.gpdm_training import Trained
from app.engine.models.labels import frame_phones
from app.engine.models.model import Input
from app.engine.models.sound import Sound
from app.engine.models.vlmm import Stretch, Vlmm
from app.engine.states import nearest_phone
from app.speech import Phone

Array = NDArray[np.float64]
Float = NDArray[np.float32]
Index = NDArray[np.int64]
Algorithm = Literal["optimisation", "prediction"]

LOW_PASS = np.array([0.25, 0.5, 0.25])
"""Of the mouths, the last step of 4.2.3; Deena 2010 has Matlab's `interp`, at a rate that the paper does not tell."""
JOIN = 0.7
"""Share of a jump at a join that is left one frame on."""


@dataclass(frozen=True)
class Scaling:
    """Between numbers as they are and standard deviations: offsets and scales of sound (D,) and sight (K,)."""

    heard_offset: Float
    heard_scale: Float
    seen_offset: Float
    seen_scale: Float


@dataclass(frozen=True)
class Part:
    """What is kept of one state.

    Attributes:
        rows: (n,) its training frames among those of the model.
        begins: (n,) which of them begin a sequence.
        points: (n, q) float32 latent points.
        kernels: (8,) of sound and of sight.
        scale: (D + K,) float32, W of both.
    """

    rows: Index
    begins: NDArray[np.bool_]
    points: Float
    kernels: Array
    scale: Float


@dataclass(frozen=True)
class SwitchingGpdm:
    """Models of many states.

    Attributes:
        name: of the kind.
        tokens: labels that were trained, silence among them.
        vlmm: says which state each frame is in; None: the states are `tokens` themselves.
        parts: of each state; None where a state has too few frames: its parent speaks for it.
        heard, seen: (F, D) and (F, K) training frames that the parts share, in standard deviations.
        scaling: of them.
        gain: (2, K) how much of each coefficient's movement from state to state, and within states, sentences that
            were left out bear out. Deena 2010 has none, that is, ones.
        rest: (K,) the mouth at rest.
        fps: frames a second.
        algorithm: of 4.2.2.
    """

    name: str
    tokens: tuple[str, ...]
    vlmm: Vlmm | None
    parts: tuple[Part | None, ...]
    heard: Float
    seen: Float
    scaling: Scaling
    gain: Float
    rest: Float
    fps: float
    algorithm: Algorithm = "optimisation"
    _ready: dict[int, State] = field(default_factory=dict, repr=False, compare=False)

    inputs: frozenset[Input] = field(default=frozenset({"phones"}), init=False, repr=False)

    def predict(
        self, phones: Sequence[Phone], frames: int, *, before: Float | None = None, sound: Sound | None = None
    ) -> Float:
        """See `app.engine.models.model.TrajectoryModel`; without sound the dynamics and the states have to do."""
        if not frames:
            return np.zeros((0, len(self.rest)), np.float32)
        scaling = self.scaling
        labels = [nearest_phone(label, self.tokens) for label in frame_phones(phones, frames, self.fps)]
        heard = None
        if sound is not None:
            heard = ((sound.frames(frames, self.fps) - scaling.heard_offset) / scaling.heard_scale).astype(np.float64)
        known = np.zeros((0, len(self.rest)))
        if before is not None and len(before):
            known = (before[-1:].astype(np.float64) - scaling.seen_offset) / scaling.seen_scale
        mouths, centres = self.mouths(labels, heard, known[0] if len(known) else None)
        return self._finished(mouths, centres, known)

    def mouths(self, labels: Sequence[str], heard: Array | None, last: Array | None) -> tuple[Array, Array]:
        """Eq. 14 at the latent points of 4.2.2, in standard deviations, before any low-pass.

        Args:
            labels: of T frames, all of them among `tokens`.
            heard: (T, D) in standard deviations; None: unknown.
            last: (K,) the mouth in front; None: unknown.

        Returns:
            Mouths (T, K), and the mean mouth of each frame's state.
        """
        mouths = np.zeros((len(labels), len(self.rest)))
        centres = np.zeros_like(mouths)
        for number, start, stop in self.stretches(labels):
            state = self.state(number)
            infer = state.optimised if self.algorithm == "optimisation" else state.predicted
            points = infer(None if heard is None else heard[start:stop], stop - start, last)
            mouths[start:stop] = state.sight.mean(points)
            centres[start:stop] = state.sight.centre
            last = mouths[stop - 1]
        return mouths, centres

    def stretches(self, labels: Sequence[str]) -> list[Stretch]:
        """States that have a model, one after the other (4.2.1)."""
        if self.vlmm is None:
            return pieces(labels, {token: number for number, token in enumerate(self.tokens)})
        return self.vlmm.stretches(labels, lambda state: self.parts[state] is not None)

    def state(self, number: int) -> State:
        """Ready to predict; made when first asked for, which may happen in two threads at once, with one result."""
        ready = self._ready.get(number)
        if ready is None:
            ready = self._ready[number] = self._made(number)
        return ready

    def _made(self, number: int) -> State:
        part = self.parts[number]
        if part is None:
            raise LookupError(f"state {number} has no model")
        heard, seen = (pool[part.rows].astype(np.float64) for pool in (self.heard, self.seen))
        scale = part.scale.astype(np.float64)
        kernels = Kernel(*part.kernels[:4]), Kernel(*part.kernels[4:])
        split = heard.shape[1]
        trained = Trained(part.points.astype(np.float64), *kernels, scale[:split], scale[split:], 0.0)
        return State.of(trained, heard, seen, part.begins)

    def _finished(self, mouths: Array, centres: Array, known: Array) -> Float:
        """Low-pass, gain, and a jump from what was before spread over the frames behind it."""
        moved = low_passed(mouths - centres)
        rows = self.gain[0] * low_passed(centres) + self.gain[1] * moved
        if len(known):
            decay = JOIN ** np.arange(1, len(rows) + 1)
            rows = rows + decay[:, None] * (known - rows[:1])
        result: Float = (rows * self.scaling.seen_scale + self.scaling.seen_offset).astype(np.float32)
        return result

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """See `app.engine.models.model.TrajectoryModel`."""
        there = [part for part in self.parts if part is not None]
        width = self.heard.shape[1] + self.seen.shape[1]
        arrays: dict[str, NDArray[Any]] = {
            "tokens": np.array(self.tokens), "heard": self.heard, "seen": self.seen, "rest": self.rest,
            "heard_scaling": np.array([self.scaling.heard_offset, self.scaling.heard_scale]),
            "seen_scaling": np.array([self.scaling.seen_offset, self.scaling.seen_scale]),
            "gain": self.gain, "fps": np.array([self.fps]),
            "state_frames": np.array([0 if part is None else len(part.rows) for part in self.parts], np.int32),
            "rows": np.concatenate([part.rows for part in there]).astype(np.int32),
            "begins": np.concatenate([part.begins for part in there]).astype(np.uint8),
            "points": np.concatenate([part.points for part in there]),
            "kernels": np.array([part.kernels for part in there]),
            "scales": np.array([part.scale for part in there]).reshape(-1, width),
        }  # fmt: skip
        if self.vlmm is not None:
            arrays["contexts"] = np.array([" ".join(context) for context in self.vlmm.contexts])
            arrays["next"] = self.vlmm.next
        return arrays


def low_passed(rows: Array) -> Array:
    """(T, K) smoothed over time; the first and the last go on beyond the ends."""
    padded = np.pad(rows, ((1, 1), (0, 0)), mode="edge")
    result: Array = LOW_PASS[0] * padded[:-2] + LOW_PASS[1] * padded[1:-1] + LOW_PASS[2] * padded[2:]
    return result
