"""When each stage of an utterance was reached, and what the last ones took (Fu 2011, section 5.3, live)."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

Stage = Literal["speech", "trajectory", "first_frame", "first_packet", "viewer", "shown"]

STAGES: tuple[Stage, ...] = get_args(Stage)
"""In order: first sound made, its trajectory solved, first frame drawn, first frame encoded and handed to the viewers,
first viewer connected, first live frame shown as the browser reports it."""

KEPT_UTTERANCES = 100


class UtteranceTimings:
    """Milliseconds from the receipt of a request to each stage; the first mark of a stage counts. Safe from any thread.

    Args:
        clock: seconds, monotonic.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._received = clock()
        self._marks: dict[Stage, float] = {}

    def mark(self, stage: Stage) -> None:
        """The stage is reached now."""
        if stage not in self._marks:  # the common case, once a frame
            self.set(stage, 1000 * (self._clock() - self._received))

    def set(self, stage: Stage, milliseconds: float) -> None:
        """The stage was reached `milliseconds` after the request, as measured by somebody else."""
        self._marks.setdefault(stage, milliseconds)

    def milliseconds(self) -> dict[Stage, float]:
        """The stages reached so far, in the order of `STAGES`."""
        marks = dict(self._marks)
        return {stage: round(marks[stage], 1) for stage in STAGES if stage in marks}


@dataclass(frozen=True, slots=True)
class Percentiles:
    """Milliseconds of one stage over `n` utterances."""

    p50: float
    p95: float
    p99: float
    n: int


@dataclass(frozen=True, slots=True)
class LoggedUtterance:
    """What the log keeps of an utterance: nothing of what was said, only its length in characters."""

    stream: str
    utterance: str
    characters: int
    timings: UtteranceTimings


@dataclass(slots=True)
class LatencyLog:
    """The last utterances of the whole service. The oldest is forgotten when `KEPT_UTTERANCES` are kept."""

    _kept: deque[LoggedUtterance] = field(default_factory=lambda: deque(maxlen=KEPT_UTTERANCES))

    def add(self, entry: LoggedUtterance) -> None:
        """Keep an utterance; stages it reaches later are seen, too."""
        self._kept.append(entry)

    def utterances(self) -> list[LoggedUtterance]:
        """The utterances kept, the newest last."""
        return list(self._kept)


def stage_percentiles(utterances: Iterable[Mapping[Stage, float]]) -> dict[Stage, Percentiles]:
    """Percentiles of every stage that any of the utterances has reached, from what `milliseconds` said of each."""
    reached: dict[Stage, list[float]] = {stage: [] for stage in STAGES}
    for milliseconds in utterances:
        for stage, value in milliseconds.items():
            reached[stage].append(value)
    return {stage: _percentiles(values) for stage, values in reached.items() if values}


def _percentiles(values: list[float]) -> Percentiles:
    p50, p95, p99 = (round(float(value), 1) for value in np.percentile(values, (50, 95, 99)))
    return Percentiles(p50, p95, p99, len(values))
