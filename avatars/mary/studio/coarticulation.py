"""From phones to face controls: every phone pulls the mouth to its viseme, neighbours overlap.

Dominance blending after Cohen and Massaro (1993): a control is the mean of all phones' targets, weighted by dominance
functions that fall off exponentially with the distance in time. Closures of the lips are then enforced, because a mean
never quite closes them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.visemes import VISEMES
from avatars.mary.studio.workspace import FPS, Workspace, read_json

Array = NDArray[np.float64]
TimedPhone = tuple[str, float, float]

LEAD = 0.05  # 50 ms: the lips are ahead of the sound
SILENCE = "SIL"
NAMES = tuple(sorted({name for controls in VISEMES.values() for name in controls}))
VOWELS = frozenset(["AA", "AE", "AH", "AO", "AW", "AY", "EH", "ER", "EY", "IH", "IY", "OW", "OY", "UH", "UW"])
SMALLEST = 0.004  # a weaker control is none
SECOND_HALF = 0.55  # of a diphthong, where its second target takes over


@dataclass(frozen=True)
class _Pull:
    """What a phone does to the mouth.

    Attributes:
        viseme: its target.
        strength: of its dominance.
        reach: seconds until that has fallen off.
        scale: of the target.
    """

    viseme: str
    strength: float
    reach: float
    scale: float = 1.0


_PULLS: dict[str, _Pull] = {
    phone: pull
    for phones, pull in (
        ("P B M", _Pull("mbp", 12, 0.050)),
        ("F V", _Pull("fv", 7, 0.055)),
        ("TH DH", _Pull("th", 4.0, 0.055)),
        ("T D N", _Pull("tdn", 1.6, 0.055, 0.8)),
        ("S Z", _Pull("sz", 2.6, 0.06, 0.85)),
        ("L", _Pull("l", 1.8, 0.055, 0.9)),
        ("K G NG", _Pull("kg", 0.8, 0.06, 0.75)),
        ("SH ZH CH JH", _Pull("sh", 3.6, 0.075)),
        ("R", _Pull("r", 2.4, 0.07, 0.9)),
        ("W", _Pull("w", 5, 0.08)),
        ("Y", _Pull("iy", 1.2, 0.06, 0.7)),
        ("HH", _Pull("hh", 0.35, 0.06, 0.7)),
        ("UW", _Pull("uw", 3.4, 0.085)),
        ("UH", _Pull("uw", 2.0, 0.075, 0.62)),
        ("AO", _Pull("ao", 2.4, 0.085)),
        ("AA", _Pull("aa", 2.4, 0.085)),
        ("AE", _Pull("ae", 2.4, 0.085)),
        ("EH", _Pull("eh", 2.0, 0.075)),
        ("IH", _Pull("ih", 1.5, 0.07, 0.9)),
        ("IY", _Pull("iy", 2.0, 0.08)),
        ("AH", _Pull("ah", 1.4, 0.07, 0.9)),
        ("ER", _Pull("er", 2.2, 0.08)),
        (SILENCE, _Pull("sil", 1.6, 0.09)),
    )
    for phone in phones.split()
}
_DIPHTHONGS: dict[str, tuple[tuple[str, float], tuple[str, float]]] = {
    "AY": (("aa", 0.85), ("iy", 0.7)),
    "AW": (("aa", 0.9), ("uw", 0.8)),
    "EY": (("eh", 1.0), ("iy", 0.8)),
    "OY": (("ao", 1.0), ("iy", 0.7)),
    "OW": (("ow", 1.0), ("uw", 0.75)),
}
"""Two targets, each with its scale."""


def _channels(*names: str) -> NDArray[np.intp]:
    return np.array([NAMES.index(name) for name in names])


_ROUND = _channels("mouthPucker", "mouthFunnel", "xRound")
_SPREAD = _channels("mouthStretchLeft", "mouthStretchRight", "mouthSmileLeft", "mouthSmileRight")
_LIPS = np.concatenate([_ROUND, _SPREAD])
_TONGUE = _channels(*(name for name in NAMES if name.startswith("t")))
_CLOSING = np.array([at for at in range(len(NAMES)) if at not in {*_ROUND.tolist(), *_TONGUE.tolist()}])

_NEUTRAL_LIPS = frozenset(["tdn", "sz", "kg", "l", "hh", "th", "mbp", "fv"])  # leave rounding to their neighbours
_NEUTRAL_TONGUE = frozenset(["mbp", "fv", "w", "uw", "hh"])
_TONGUE_FIRST = frozenset(["tdn", "l", "th", "kg"])
_CLOSURES = frozenset(["mbp", "fv"])


def write_curves(workspace: Workspace) -> None:
    """Write the face controls of every frame."""
    phones = [(symbol, start, end) for symbol, start, end in read_json(workspace.phones)]
    weights = curves(phones, phones[-1][2])
    np.savez(workspace.weights, weights=weights.astype(np.float32), names=np.array(NAMES), fps=FPS, lead=LEAD)


def curves(phones: Sequence[TimedPhone], duration: float) -> Array:
    """(T, C) controls in the order of `NAMES`, `FPS` frames a second.

    Args:
        phones: gapless, seconds.
        duration: of the sound, seconds.
    """
    segments = _segments(phones)
    times = np.arange(int(np.ceil(duration * FPS))) / FPS + LEAD
    total = np.zeros((len(times), len(NAMES)))
    dominance = np.full_like(total, 1e-6)
    for phone, start, end, pull in segments:
        length = end - start
        reduction = 0.62 + 0.38 * min(1, length / 0.12) if phone in VOWELS else 1.0  # fast vowels undershoot
        core = max(0, length / 2 - 0.07) if phone == SILENCE else max(0.004, length / 2 - 0.02)
        outside = np.maximum(0, np.abs(times - (start + end) / 2) - core)
        own = np.repeat((pull.strength * np.exp(-((outside / (pull.reach * 0.88)) ** 1.6)))[:, None], len(NAMES), 1)
        own[:, _LIPS] = pull.strength * np.exp(-((outside / pull.reach) ** 1.7))[:, None]
        if pull.viseme in _NEUTRAL_LIPS:
            own[:, _LIPS] *= 0.35
        if pull.viseme in _NEUTRAL_TONGUE:
            own[:, _TONGUE] *= 0.2
        if pull.viseme in _TONGUE_FIRST:
            own[:, _TONGUE] *= 2.5
        total += own * _target(pull.viseme, pull.scale * reduction)
        dominance += own
    weights = total / dominance
    _close(weights, times, segments)
    weights[np.abs(weights) < SMALLEST] = 0
    weights[_silent(phones, times)] = 0
    return weights


def _segments(phones: Sequence[TimedPhone]) -> list[tuple[str, float, float, _Pull]]:
    """Phones with what they do; a diphthong is two."""
    segments = []
    for phone, start, end in phones:
        if phone not in _DIPHTHONGS:
            segments.append((phone, start, end, _PULLS[phone]))
            continue
        (first, first_scale), (second, second_scale) = _DIPHTHONGS[phone]
        change = start + SECOND_HALF * (end - start)
        segments.append((phone, start, change, _Pull(first, 2.4, 0.07, first_scale)))
        segments.append((phone, change, end, _Pull(second, 1.8, 0.07, second_scale)))
    return segments


def _target(viseme: str, scale: float = 1.0) -> Array:
    """(C,) the controls of a viseme."""
    return np.array([VISEMES[viseme].get(name, 0.0) * scale for name in NAMES])


def _close(weights: Array, times: Array, segments: Sequence[tuple[str, float, float, _Pull]]) -> None:
    """Let P, B, M, F and V reach their targets, for two frames at least."""
    for _, start, end, pull in segments:
        if pull.viseme not in _CLOSURES:
            continue
        core = max(0.022, (end - start) / 2 - 0.012)
        outside = np.maximum(0, np.abs(times - (start + end) / 2) - core)
        share = np.exp(-((outside / 0.030) ** 2))[:, None]
        weights[:, _CLOSING] = weights[:, _CLOSING] * (1 - share) + _target(pull.viseme)[_CLOSING] * share
        weights[:, _ROUND] *= 1 - 0.45 * share


def _silent(phones: Sequence[TimedPhone], times: Array) -> NDArray[np.bool_]:
    """(T,) frames far enough from any phone to be exactly at rest: their pictures are all the same."""
    silent = np.ones(len(times), dtype=np.bool_)
    for phone, start, end in phones:
        if phone != SILENCE:
            silent &= (times < start - 0.12) | (times > end + 0.14)
    return silent
