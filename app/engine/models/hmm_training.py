"""Training of the audio-visual hidden Markov models (Wang 2010, 3.2).

Phones lie where their labels have them: the talking head will be given labels of the same making, and has to keep to
them. The states inside a phone are found by Viterbi on sound and mouth together, with models that know no context;
then the contexts are tied by trees, one set for what is heard and one for what is seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.engine.metrics import trajectory_scores
from app.engine.models.hmm_context import THIS, Labels, contexts
from app.engine.models.hmm_recognition import phone_grammar
from app.engine.models.hmm_rows import ROWS, heard_rows, rows_of, seen_rows
from app.engine.models.hmm_states import (
    MOST,
    Durations,
    add_fits,
    align,
    even_durations,
    learnt_durations,
    phone_rows,
    slots_of,
)
from app.engine.models.hmm_stream import Gathered, Stream, gathered, grown, tied
from app.engine.models.hmm_trajectory import Hearing, HmmTrajectory
from app.engine.models.hmm_tree import Tree
from app.engine.models.mfcc import FILTERS
from app.engine.models.model import Spoken
from app.engine.states import silences_joined
from app.speech import PHONES, SILENCE, Phone

Float = NDArray[np.float32]
Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Flags = NDArray[np.bool_]

ALIGNMENTS = 4
"""Times that states are looked for, the first time from even ones."""
LEFT_OUT = 6
"""Every so manyth sentence is for validation."""
FEW = 36
"""Sentences: with fewer, each is left out once, a `LEFT_OUT`th of them at a time."""
LEAST_SENTENCES = 4
"""With fewer, nothing is chosen."""
LEADS = (0, 4, 8)
"""Rows by which the lips may be ahead of the sound: 0 to 40 ms at 25 fps."""
PENALTIES = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
DYNAMICS = (0.3, 1.0, 3.0)


@dataclass(frozen=True)
class Settings:
    """What is chosen on sentences left out.

    Attributes:
        lead: rows by which the lips are ahead of the sound.
        penalty: of a split in the trees of what is seen (`hmm_tree`).
        dynamics: weight of delta and delta-delta in generation; 1 is the likelihood.
    """

    lead: int = 4
    penalty: float = 0.7
    dynamics: float = 1.0


LEVEL = 12.0
"""dB: standard deviation of how much louder than in the recording somebody may speak."""
HEARD_PENALTY = 0.3
"""Of a split in the trees of what is heard: larger ones than the minimum description length recognise more."""
PLAIN_PENALTY = 1.0
"""Of a split in the trees without context that states are looked for with."""


@dataclass(frozen=True)
class Observed:
    """Rows of many stretches of speech, one after the other.

    Attributes:
        starts: (N + 1,) first row of each phone.
        contexts: (N, 3).
        counts: (N,) states of each phone.
        heard: (R, 60); None if somewhere no sound is known.
        seen: (R, 3 K), in standard deviations from rest.
        sure: (R,) which of them count.
    """

    starts: Numbers
    contexts: Labels
    counts: Numbers
    heard: Array | None
    seen: Array
    sure: Flags


def observed(spoken: Sequence[Spoken], heard: Sequence[Array | None], base: HmmTrajectory, lead: int) -> Observed:
    """Rows of what was said; `heard` are those of each sound."""
    starts, labels, seen, sure = [np.zeros(1, np.int64)], [], [], []
    for each in spoken:
        rows = rows_of(len(each.counted))
        phones = silences_joined(each.phones) or [Phone(SILENCE, 0.0, len(each.counted) / base.fps)]
        starts.append(starts[-1][-1] + phone_rows(phones, 0, rows, ROWS * base.fps)[1:])
        labels.append(contexts(phones, base.phones))
        one, counts = seen_rows((each.coefficients - base.rest) / base.scale, each.counted, -lead, rows)
        seen.append(one)
        sure.append(counts)
    known = [each for each in heard if each is not None]
    stacked = np.concatenate(labels)
    return Observed(
        np.concatenate(starts), stacked, slots_of(stacked)[1],
        np.concatenate(known) if len(known) == len(heard) else None, np.concatenate(seen), np.concatenate(sure),
    )  # fmt: skip


def aligned(data: Observed) -> Numbers:
    """(N, MOST) rows of every state, by Viterbi inside the bounds of each phone, repeated."""
    states = even_durations().states(data.contexts, np.diff(data.starts))
    streams = [(data.seen, data.sure)]
    if data.heard is not None:
        streams.append((data.heard, np.ones(len(data.heard), bool)))
    for _ in range(ALIGNMENTS):
        fits = np.zeros((int(data.starts[-1]), MOST))
        for rows, usable in streams:
            found = gathered(data.contexts, states, rows, usable)
            model = tied(found, grown(found, penalty=PLAIN_PENALTY, columns=[THIS]))
            leaves = model.leaves(data.contexts)
            add_fits(data.starts, data.counts, leaves, rows, usable, model.mean, model.variance, fits)
        align(data.starts, data.counts, fits, states)
    return states


@dataclass(frozen=True)
class Grown:
    """All that does not depend on penalty and dynamics.

    Attributes:
        durations: of states.
        seen: what was seen in each context.
        trees: on it, as large as the least penalty lets them grow.
        hearing: what recognises phones; None without sound.
    """

    durations: Durations
    seen: Gathered
    trees: tuple[Tree, ...]
    hearing: Hearing | None

    def model(self, settings: Settings, base: HmmTrajectory) -> HmmTrajectory:
        """Trees cut back to the penalty."""
        stream = tied(self.seen, tuple(tree.cut(settings.penalty) for tree in self.trees))
        return replace(
            base, seen=stream.rounded(), durations=self.durations, hearing=self.hearing, lead=settings.lead,
            dynamics=settings.dynamics,
        )  # fmt: skip


def grow_all(data: Observed, base: HmmTrajectory, penalty: float, *, hear: bool) -> Grown:
    """Align, then grow the trees."""
    states = aligned(data)
    durations = learnt_durations(data.contexts, states).rounded()
    seen = gathered(data.contexts, states, data.seen, data.sure)
    hearing = None
    if data.heard is not None and hear:
        found = gathered(data.contexts, states, data.heard, np.ones(len(data.heard), bool))
        stream = tied(found, grown(found, penalty=HEARD_PENALTY))
        # Nobody knows how loud live sound will be: loudness tells less than in the recording.
        stream.variance[:, 0] += (LEVEL / 10 * np.log(10)) ** 2 * FILTERS
        places = np.array([PHONES.index(symbol) for symbol in base.phones])
        hearing = Hearing(stream.rounded(), phone_grammar(data.contexts, places))
    return Grown(durations, seen, grown(seen, penalty=penalty), hearing)


def learn(
    spoken: Sequence[Spoken], rest: Float, *, fps: float, progress: Callable[[float], None] = lambda _: None
) -> tuple[HmmTrajectory, Settings]:
    """Choose the settings on sentences left out, then learn from all.

    Args:
        spoken: each with a frame that counts.
        rest: (K,) the mouth at rest.
        fps: frames a second.
        progress: told the share done.
    """
    heard = [
        None if each.sound is None else heard_rows(each.sound, 0, rows_of(len(each.counted)), fps) for each in spoken
    ]
    settings = Settings()
    if len(spoken) >= LEAST_SENTENCES:
        settings = _chosen(spoken, heard, rest, fps, progress)
    base = untrained(spoken, rest, fps)
    model = grow_all(observed(spoken, heard, base, settings.lead), base, settings.penalty, hear=True)
    progress(1.0)
    return model.model(settings, base), settings


def untrained(spoken: Sequence[Spoken], rest: Float, fps: float) -> HmmTrajectory:
    """A model that knows phones and scale only."""
    symbols = {phone.symbol for each in spoken for phone in each.phones} | {SILENCE}
    rows = np.concatenate([each.coefficients[each.counted] for each in spoken]).astype(np.float64)
    scale = np.maximum(rows.std(0), 1e-6).astype(np.float32).astype(np.float64)
    nothing = np.zeros((0, 3 * len(rest)))
    return HmmTrajectory(
        tuple(symbol for symbol in PHONES if symbol in symbols), Stream((), nothing, nothing), even_durations(), None,
        scale, np.asarray(rest, np.float32), fps, 0, 1.0,
    )  # fmt: skip


def _chosen(
    spoken: Sequence[Spoken], heard: Sequence[Array | None], rest: Float, fps: float,
    progress: Callable[[float], None],
) -> Settings:  # fmt: skip
    """The settings with the least error on sentences left out: the lead first, then the others together."""
    count = min(LEFT_OUT, len(spoken))
    parts = [range(part, len(spoken), count) for part in range(count)]
    folds = parts if len(spoken) < FEW else parts[count // 2 :][:1]
    learnt = [[at for at in range(len(spoken)) if at not in held] for held in folds]
    bases = [untrained([spoken[at] for at in places], rest, fps) for places in learnt]
    held = [spoken[at] for fold in folds for at in fold]
    scale = np.mean([base.scale for base in bases], 0)

    def error(models: Sequence[HmmTrajectory]) -> float:
        said = [
            model.predict(spoken[at].phones, len(spoken[at].counted))
            for model, fold in zip(models, folds, strict=True) for at in fold
        ]  # fmt: skip
        return trajectory_scores(
            [rows[each.counted] for rows, each in zip(said, held, strict=True)],
            [each.coefficients[each.counted] for each in held], scale,
        ).error_weighted  # fmt: skip

    best: tuple[float, Settings, list[Grown]] | None = None
    for step, lead in enumerate(LEADS):
        grown_now = [
            grow_all(
                observed([spoken[at] for at in places], [heard[at] for at in places], base, lead), base,
                PENALTIES[0], hear=False,
            )
            for places, base in zip(learnt, bases, strict=True)
        ]  # fmt: skip
        tried = Settings(lead=lead)
        found = error([each.model(tried, base) for each, base in zip(grown_now, bases, strict=True)])
        if best is None or found < best[0]:
            best = found, tried, grown_now
        progress(0.8 * (step + 1) / len(LEADS))
    assert best is not None
    for penalty in PENALTIES:
        for dynamics in DYNAMICS:
            tried = replace(best[1], penalty=penalty, dynamics=dynamics)
            found = error([each.model(tried, base) for each, base in zip(best[2], bases, strict=True)])
            if found < best[0]:
                best = found, tried, best[2]
    return best[1]
