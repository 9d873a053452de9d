"""The kinds of trajectory models by name, and training with what goes in checked first."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from app.engine.models.model import Kind, SeeingKind, Spoken, TrajectoryModel
from app.engine.modes import Modes
from app.errors import BadPack, NotFound, TrainingFailed
from app.plugins import Plugins
from app.speech import PHONES, SILENCE

DEFAULT = "gaussian"
"""The kind that every pack has, in `model.npz`."""

KINDS: Plugins[Kind] = Plugins(
    kind="trajectory model",
    group="mary.trajectory",
    field="trajectory",
    ours={
        DEFAULT: ("app.engine.models.gaussian", "GaussianKind"),
        "hmm": ("app.engine.models.hmm", "HmmKind"),
        "phone-mean": ("app.engine.models.phone_mean", "PhoneMeanKind"),
        "network": ("app.engine.models.network", "NetworkKind"),
        "vlmm-gpdm": ("app.engine.models.gpdm_kinds", "VlmmGpdmKind"),
        "voice-puppetry": ("app.engine.models.voice_puppetry_training", "VoicePuppetryKind"),
        "phone-gpdm": ("app.engine.models.gpdm_kinds", "PhoneGpdmKind"),
    },
    protocol=Kind,
    broken=BadPack,
)


def kind(name: str) -> Kind:
    """The kind of this name.

    Raises:
        NotFound: there is none; the advice lists those there are.
        MissingExtra: a library that it needs is not installed.
    """
    return KINDS.create(name)


def check_kinds(names: Sequence[str], *, field: str = "models") -> None:
    """Raise `NotFound` unless all of these are kinds."""
    for name in names:
        if name not in KINDS.names():
            raise NotFound(
                f"there is no trajectory model {name!r}", field=field, advice=f"Known: {', '.join(KINDS.names())}."
            )


def fit(
    name: str,
    spoken: Sequence[Spoken],
    rest: NDArray[np.float32],
    *,
    fps: float,
    seed: int = 0,
    progress: Callable[[float], None] = lambda _: None,
    modes: Modes | None = None,
) -> TrajectoryModel:
    """Train a model of one kind; see `Kind.fit`, and `SeeingKind.fit` for `modes`.

    Raises:
        NotFound, MissingExtra: see `kind`.
        TrainingFailed: the recording is too short for it, lacks sound, or holds phones or numbers that are none.
    """
    wanted = kind(name)
    heard = [each for each in spoken if each.counted.any()]
    check_spoken(wanted, heard, rest, fps)
    if isinstance(wanted, SeeingKind):
        return wanted.fit(heard, rest, fps=fps, seed=seed, progress=progress, modes=modes)
    return wanted.fit(heard, rest, fps=fps, seed=seed, progress=progress)


def check_spoken(wanted: Kind, spoken: Sequence[Spoken], rest: NDArray[np.float32], fps: float) -> None:
    """Raise `TrainingFailed` unless a kind can be trained on this."""
    for number, each in enumerate(spoken):
        where = f"{wanted.name}: sentence {number}"
        unknown = sorted({phone.symbol for phone in each.phones} - set(PHONES))
        if unknown:
            raise TrainingFailed(f"{where} holds {unknown[0]!r}, which is not ARPAbet without stress")
        if each.coefficients.shape != (len(each.counted), len(rest)):
            raise TrainingFailed(f"{where} has coefficients {each.coefficients.shape}, not one row a frame")
        if not np.isfinite(each.coefficients[each.counted]).all():
            raise TrainingFailed(f"{where} holds coefficients that are not finite")
        if wanted.hears and each.sound is None:
            raise TrainingFailed(f"{where} has no sound", advice="Give videos with sound.")
    seconds = sum(seconds_of_speech(each, fps) for each in spoken)
    if seconds < wanted.least:
        raise TrainingFailed(
            f"{seconds:.0f} s of speech are too little for {wanted.name}, which needs {wanted.least:.0f} s",
            advice="Record more, or leave this model out.",
        )


def seconds_of_speech(spoken: Spoken, fps: float) -> float:
    """How long something is said in the frames that count."""
    times = np.arange(len(spoken.counted)) / fps
    speech = np.zeros(len(times), bool)
    for phone in spoken.phones:
        if phone.symbol != SILENCE:
            speech |= (times >= phone.start) & (times < phone.end)
    return float((speech & spoken.counted).sum() / fps)
