"""How right the phone times of engines and aligners are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from app.align.agreement import Starts, starts
from app.align.aligner import Aligner
from app.align.phone_agreement import start_differences
from app.errors import AlignmentFailed, NothingToSay, SpeechFailed
from app.speech import Phone, Speech

Speak = Callable[[str], Speech]
"""A sentence to its speech."""


@dataclass(frozen=True, slots=True)
class TimingRow:
    """Phone starts of one source of times, laid beside those of another.

    Attributes:
        measured: what is measured.
        against: what is taken for right.
        calibrated: with the constants found by such a measurement; otherwise without them.
        sentences: spoken or aligned.
        failures: sentences for which there are no times, not counted above.
        starts: None if nothing could be compared.
    """

    measured: str
    against: str
    calibrated: bool
    sentences: int
    failures: int
    starts: Starts | None


def aligner_row(
    aligner: Aligner, spoken: Iterable[tuple[str, Speech]], against: str, *, calibrated: bool = True
) -> TimingRow:
    """An aligner on speech whose times are known.

    Args:
        aligner: to be measured.
        spoken: sentences and their speech, with the right phones.
        against: what spoke them.
        calibrated: see `TimingRow`.
    """
    pairs: list[tuple[Sequence[Phone], Sequence[Phone]]] = []
    failures = 0
    for text, speech in spoken:
        try:
            found = aligner.align(speech.samples, speech.rate, text)
        except (AlignmentFailed, NothingToSay):
            failures += 1
        else:
            pairs.append((found.phones, speech.phones))
    return _row(aligner.name, against, calibrated, pairs, failures)


def engine_row(
    engine: str, speak: Speak, sentences: Iterable[str], aligner: Aligner, *, calibrated: bool = True
) -> TimingRow:
    """An engine's own times beside an aligner's on the same sound.

    Args:
        engine: its name.
        speak: with the engine's own times.
        sentences: to speak.
        aligner: taken for right.
        calibrated: see `TimingRow`.
    """
    pairs: list[tuple[Sequence[Phone], Sequence[Phone]]] = []
    failures = 0
    for text in sentences:
        try:
            speech = speak(text)
            found = aligner.align(speech.samples, speech.rate, text)
        except (SpeechFailed, AlignmentFailed, NothingToSay):
            failures += 1
        else:
            pairs.append((speech.phones, found.phones))
    return _row(engine, aligner.name, calibrated, pairs, failures)


def _row(
    measured: str,
    against: str,
    calibrated: bool,
    pairs: Sequence[tuple[Sequence[Phone], Sequence[Phone]]],
    failures: int,
) -> TimingRow:
    errors = [1000 * start_differences(ours, theirs) for ours, theirs in pairs]
    found = starts(np.concatenate(errors).tolist()) if errors else None
    return TimingRow(measured, against, calibrated, len(pairs), failures, found)
