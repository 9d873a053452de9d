"""Trajectory models beside the avatar's Gaussians, trained on the same recording and kept in the same pack."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from app.engine.models.model import Spoken
from app.engine.models.model_file import save_trajectory
from app.engine.models.registry import DEFAULT, KINDS, check_kinds, fit, kind
from app.engine.models.sound import Sound
from app.engine.modes import Modes
from app.engine.pack import FPS, MODEL, MODELS, digest
from app.engine.selection_library import NAME as SELECTION
from app.engine.training.articulation import spoken_passages
from app.engine.training.corpus import Corpus, Float, Progress
from app.engine.training.take import Take
from app.engine.training.workspace import Workspace, key
from app.errors import NotFound

Hear = Callable[[Take], Sound]
"""The sound of a take, its first picture at time 0."""


def check_further(names: Sequence[str]) -> list[str]:
    """Those of what a pack may have besides that are trajectory models; the other is the selection renderer's samples.

    Raises:
        NotFound: one is neither.
    """
    kinds = [name for name in names if name != SELECTION]
    unknown = [name for name in kinds if name not in KINDS.names()]
    if unknown:
        raise NotFound(
            f"there is no trajectory model {unknown[0]!r}", field="models",
            advice=f"Known: {', '.join((*KINDS.names(), SELECTION))}.",
        )  # fmt: skip
    return kinds


def heard_passages(corpus: Corpus, coefficients: Float, rest: Float, hear: Hear | None) -> list[Spoken]:
    """`spoken_passages` with their sound: that of the whole take, so that a passage also hears what is around it."""
    spoken = spoken_passages(corpus, coefficients, rest)
    if hear is None:
        return spoken
    whole = {number: hear(corpus.takes[number]) for number in sorted({each.take for each in corpus.passages})}
    return [
        replace(each, sound=whole[passage.take].moved(passage.first / FPS))
        for passage, each in zip(corpus.passages, spoken, strict=True)
    ]


def train_further(
    names: Sequence[str], spoken: Sequence[Spoken], rest: Float, draft: Path, workspace: Workspace, *, seed: int,
    progress: Progress, mouths: Modes | None = None,
) -> None:  # fmt: skip
    """Train models and write them into a pack that has its `model.npz`; finished ones are kept in the workspace.

    Args:
        names: of kinds.
        spoken: `heard_passages`.
        rest: (K,) the mouth at rest.
        draft: the pack's folder.
        workspace: keeps what is finished.
        seed: of everything random.
        progress: see `Progress`.
        mouths: the pack's modes, for kinds that look at what they say.

    Raises:
        NotFound, MissingExtra: see `app.engine.models.registry.kind`.
        TrainingFailed: the recording does not do for one of them.
    """
    wanted = list(dict.fromkeys(name for name in names if name != DEFAULT))
    check_kinds(wanted)
    modes = digest(draft / MODEL)
    of_speech = key(rest, [[each.coefficients, each.counted, _phones(each), _sound(each)] for each in spoken], seed)
    for number, name in enumerate(wanted):

        def told(share: float, number: int = number) -> None:
            progress("further models", (number + share) / len(wanted))

        told(0.0)
        made = kind(name)
        arrays = workspace.step(
            f"model_{name}", key(of_speech, name, made.version),
            lambda name=name, told=told: fit(  # type: ignore[misc]
                name, spoken, rest, fps=FPS, seed=seed, progress=told, modes=mouths
            ).to_arrays(),
        )  # fmt: skip
        save_trajectory(draft / MODELS / f"{name}.npz", made, arrays, modes=modes)


def _phones(spoken: Spoken) -> list[tuple[str, float, float]]:
    return [(phone.symbol, round(phone.start, 4), round(phone.end, 4)) for phone in spoken.phones]


def _sound(spoken: Spoken) -> list[object]:
    return [] if spoken.sound is None else [spoken.sound.samples, spoken.sound.rate, spoken.sound.start]
