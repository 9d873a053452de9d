"""What a recogniser is: it hears phones in sound without being told what is said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from app.align.pauses import close_gaps, trim
from app.align.phoneset import Sound
from app.speech import SILENCE, Phone

RATE = 16_000  # samples a second that recognisers listen to

BEFORE = 0.070  # 70 ms: a phone after a pause begins this long before it is heard best
AFTER = 0.120  # 120 ms: a phone before a pause ends this long after
LONGEST_STEP = 0.250  # 250 ms between two phones: more is a pause, or a phone that is drawn out (the energy tells)
SILENT = 1e-3  # -60 dB: the peak of sound in which nothing can be heard

CHUNK = 6.0  # seconds of a long recording that are listened to at once,
OVERLAP = 1.0  # with this much of what is before and after, so that no phone is cut

Samples = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Heard:
    """A phone and the moment at which it is heard best, seconds from the first sample."""

    symbol: str
    at: float


@runtime_checkable
class Recogniser(Protocol):
    """Hears phones. Everything here blocks; `hear` may be called from several threads."""

    @property
    def name(self) -> str: ...

    def warm_up(self) -> None:
        """Load what hearing needs. May be called again; then it does nothing."""
        ...

    def hear(self, samples: Samples) -> Sequence[Heard]:
        """The phones in a few seconds of sound.

        Args:
            samples: mono waveform in [-1, 1], `RATE` samples a second, shape (n,); n may be 0.

        Returns:
            phones but no silences, in order of time.

        Raises:
            RecognitionFailed: the recogniser broke down; names it.
        """
        ...


def phones(heard: Sequence[Heard], samples: Samples) -> list[Phone]:
    """Phones from the moments at which they are heard best.

    Borders lie midway between two phones; beside pauses the energy decides.

    Args:
        heard: in order of time.
        samples: what they were heard in, shape (n,), `RATE` samples a second.

    Returns:
        gapless phones from 0 to the end of the samples.
    """
    duration = len(samples) / RATE
    sounds: list[Sound] = []
    at = 0.0
    for number, each in enumerate(heard):
        before = heard[number - 1].at if number else -np.inf
        after = heard[number + 1].at if number + 1 < len(heard) else np.inf
        start = each.at - BEFORE if each.at - before > LONGEST_STEP else (each.at + before) / 2
        end = each.at + AFTER if after - each.at > LONGEST_STEP else (each.at + after) / 2
        start, end = max(start, at), min(end, duration)
        if end <= start:
            continue
        if start > at:
            sounds.append(Sound(SILENCE, at, start))
        sounds.append(Sound(each.symbol, start, end))
        at = end
    if at < duration:
        sounds.append(Sound(SILENCE, at, duration))
    return [Phone(sound.symbol, sound.start, sound.end) for sound in trim(close_gaps(sounds), samples, RATE)]


def recognise(recogniser: Recogniser, samples: Samples) -> tuple[Phone, ...]:
    """Phones of a whole recording, however long: it is listened to piece by piece.

    Args:
        recogniser: listens.
        samples: shape (n,), `RATE` samples a second.

    Returns:
        gapless phones from 0 to the end of the samples; none of an empty recording.

    Raises:
        RecognitionFailed: see `Recogniser.hear`.
    """
    heard: list[Heard] = []
    duration = len(samples) / RATE
    for start in np.arange(0.0, duration, CHUNK).tolist():
        first = max(0.0, start - OVERLAP)
        window = samples[round(first * RATE) : round((start + CHUNK + OVERLAP) * RATE)]
        end = min(start + CHUNK, duration)
        heard += [
            Heard(each.symbol, each.at + first) for each in recogniser.hear(window) if start <= each.at + first < end
        ]
    return tuple(phones(heard, samples)) if len(samples) else ()
