"""The trajectory model of Wang 2010: the most likely mouths under the states of phones, or of what is heard."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.engine.models.hmm_context import QUIET, Labels, contexts, questions
from app.engine.models.hmm_generation import generate
from app.engine.models.hmm_recognition import Loop, row_likelihoods
from app.engine.models.hmm_rows import ROWS, heard_rows, rows_of
from app.engine.models.hmm_states import MOST, Durations, add_fits, align, slots_of
from app.engine.models.hmm_stream import Stream, stored_stream
from app.engine.models.mfcc import FILTERS, FLOOR
from app.engine.models.model import Input
from app.engine.models.sound import Sound
from app.engine.states import silences_joined
from app.speech import PHONES, SILENCE, Phone

Float = NDArray[np.float32]
Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

AFTER = ROWS
"""Rows made behind the last frame: where a trajectory breaks off, its dynamics are not known."""
REST_AFTER = 1.0
"""Seconds from speech at which the mouth is at rest: talkers open it long before they begin, and close it slowly."""
BEFORE = 4
"""Frames before that a trajectory goes on from."""
CERTAIN = 1e8
"""Precision of what was shown already."""
HUSH = float((np.log(FLOOR) + 1.0) * np.sqrt(FILTERS))
"""Loudness (the first of the MFCC) hardly above that of no sound at all: silence for certain."""
IMPOSSIBLE = 1e4
"""Log likelihood that speech does not have where nothing is heard."""


@dataclass(frozen=True)
class Hearing:
    """What recognises phones.

    Attributes:
        stream: tied states of what is heard.
        grammar: (P, P, P) of the trained phones, see `app.engine.models.hmm_recognition.phone_grammar`.
    """

    stream: Stream
    grammar: Array


@dataclass(frozen=True)
class Passed:
    """States one after the other.

    Attributes:
        contexts: (N, 3) of the phones.
        leaves: (N, MOST) what is seen in each state.
        lasting: (N, MOST) its rows.
        begin: row at which the first phone begins.
    """

    contexts: Labels
    leaves: Numbers
    lasting: Numbers
    begin: int

    def at(self, rows: Numbers, rest_after: int) -> tuple[Numbers, NDArray[np.bool_]]:
        """What is seen in each of some rows, and which of them are so many rows from all speech: the mouth rests.

        The first state reaches back to any row, the last one on to any.
        """
        lasting = self.lasting.ravel()
        ends = self.begin + np.cumsum(lasting)
        last = int(np.flatnonzero(lasting)[-1]) if lasting.any() else 0
        state = np.minimum(np.searchsorted(ends, rows, side="right"), last)
        phone = state // MOST
        closes = ends.reshape(-1, MOST)[:, -1]
        opens = closes - self.lasting.sum(1)
        last_spoke, speaks, next_speaks = self.contexts[phone].T != QUIET
        near = (last_spoke & (rows < opens[phone] + rest_after)) | (next_speaks & (rows >= closes[phone] - rest_after))
        return self.leaves.ravel()[state], ~(speaks | near)


@dataclass(frozen=True)
class HmmTrajectory:
    """See `app.engine.models.model.TrajectoryModel`.

    Attributes:
        phones: that were trained, silence among them.
        seen: tied states of what is seen, in standard deviations.
        durations: of states.
        hearing: None if it was trained without sound.
        scale: (K,) standard deviations of coefficients.
        rest: (K,) the mouth at rest.
        fps: frames a second.
        lead: rows by which the lips are ahead of the sound.
        dynamics: weight of dynamic features; 1 is the likelihood.
    """

    phones: tuple[str, ...]
    seen: Stream
    durations: Durations
    hearing: Hearing | None
    scale: Array
    rest: Float
    fps: float
    lead: int
    dynamics: float

    name = "hmm"

    @property
    def inputs(self) -> frozenset[Input]:
        """Phones; sound too if it was trained with it."""
        return frozenset({"phones"} if self.hearing is None else {"phones", "sound"})

    def predict(
        self, phones: Sequence[Phone], frames: int, *, before: Float | None = None, sound: Sound | None = None
    ) -> Float:
        """See `app.engine.models.model.TrajectoryModel`; where phones are known, the sound does not matter."""
        if frames <= 0:
            return np.zeros((0, len(self.rest)), np.float32)
        known = self._standard(before)
        first = -ROWS * len(known)
        rows = first + np.arange(rows_of(frames) + AFTER - first)
        if phones:
            passed = self._said(phones)
        elif sound is not None and self.hearing is not None and len(sound.heard):
            passed = self._heard(sound)
        else:
            passed = self._said([Phone(SILENCE, 0.0, frames / self.fps)])
        shown, resting = passed.at(rows + self.lead, round(REST_AFTER * ROWS * self.fps))
        count = len(self.rest)
        mean, precision = self.seen.mean[shown], 1 / self.seen.variance[shown]
        mean[resting] = 0.0
        precision[:, count:] *= self.dynamics
        mean[:-first:ROWS, :count], precision[:-first:ROWS, :count] = known, CERTAIN
        made = generate(mean, precision)
        return (made[-first::ROWS][:frames] * self.scale + self.rest).astype(np.float32)

    def _standard(self, before: Float | None) -> Array:
        """(b, K) the last frames before that matter, in standard deviations from rest."""
        frames = np.zeros((0, len(self.rest))) if before is None else before[-BEFORE:].astype(np.float64)
        return (frames - self.rest) / self.scale

    def _said(self, phones: Sequence[Phone]) -> Passed:
        """States of phones."""
        joined = silences_joined(phones)
        times = np.array([joined[0].start, *(phone.end for phone in joined)])
        edges = np.maximum.accumulate(np.ceil(times * (ROWS * self.fps) - 1e-6).astype(np.int64))
        labels = contexts(joined, self.phones)
        lasting = self.durations.states(labels, np.diff(edges))
        return Passed(labels, self.seen.leaves(labels), lasting, int(edges[0]))

    @cached_property
    def _loop(self) -> Loop:
        assert self.hearing is not None
        places = np.array([PHONES.index(symbol) for symbol in self.phones])
        return Loop.of(self.hearing.stream, self.durations, places, self.hearing.grammar)

    def _heard(self, sound: Sound) -> Passed:
        """The same from the sound: the best phones, and the best states in them."""
        assert self.hearing is not None
        rate = ROWS * self.fps
        begin = round(sound.start * rate)
        count = max(1, round(len(sound.samples) / sound.rate * rate))
        heard = heard_rows(sound, begin, count, self.fps)
        stream = self.hearing.stream
        sure = heard[:, 0] > HUSH
        fits = row_likelihoods(stream, heard)
        fits[~sure] = np.where(np.arange(fits.shape[1]) < stream.spoken, -IMPOSSIBLE, 0.0)
        places, starts = self._loop.recognise(fits)
        labels = np.stack([np.append(QUIET, places[:-1]), places, np.append(places[1:], QUIET)], 1).astype(np.int16)
        counts = slots_of(labels)[1]
        states = self.durations.states(labels, np.diff(starts))
        fits = np.zeros((count, states.shape[1]))
        add_fits(starts, counts, stream.leaves(labels), heard, sure, stream.mean, stream.variance, fits)
        align(starts, counts, fits, states)
        return Passed(labels, self.seen.leaves(labels), states, begin)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """See `app.engine.models.model.TrajectoryModel`; read again by `app.engine.models.hmm.HmmKind`."""
        arrays = {
            "phones": np.array(self.phones),
            "questions": questions().yes.astype(np.uint8),
            "duration_mean": self.durations.mean.astype(np.float32),
            "duration_variance": self.durations.variance.astype(np.float32),
            "scale": self.scale.astype(np.float32),
            "rest": self.rest,
            "settings": np.array([self.fps, self.lead, self.dynamics]),
        } | stored_stream(self.seen, "seen")
        if self.hearing is not None:
            arrays |= stored_stream(self.hearing.stream, "heard")
            arrays["grammar"] = self.hearing.grammar.astype(np.float32)
        return arrays
