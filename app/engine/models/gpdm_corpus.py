"""Which frames train the model of which state, and the training of them all (Deena 2010, 3.2 and 4.1)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from app.engine.models.gpdm_training import Likelihood, Trained, train
from app.engine.models.labels import frame_phones
from app.engine.models.mfcc import RATE
from app.engine.models.model import Spoken
from app.engine.models.sound import Sound
from app.engine.models.vlmm import Stretch, Vlmm
from app.engine.states import nearest_phone
from app.speech import PHONES, SILENCE

Array = NDArray[np.float64]
Float = NDArray[np.float32]
Index = NDArray[np.int64]

LEAST_FRAMES = 8
"""Frames, and `LEAST_WINDOWS`, below which a state gets no model: its parent in the tree speaks for it."""
LEAST_WINDOWS = 2
LONGEST = 8
"""Labels that a state of the Markov model remembers; phones that last longer are cut into pieces of so many frames."""


@dataclass(frozen=True)
class Corpus:
    """Sentences laid end to end, in standard deviations.

    Attributes:
        labels: of every frame, by sentence.
        starts: (sentences + 1,) number of each sentence's first frame.
        counted: (F,) frames to be learnt from.
        heard: (F, D) MFCC.
        seen: (F, K) mouth coefficients, each sentence's mean where its phones' are (3.2).
        heard_offset, heard_scale: (D,) what was taken off, and by what divided.
        seen_offset, seen_scale: (K,).
    """

    labels: tuple[tuple[str, ...], ...]
    starts: Index
    counted: NDArray[np.bool_]
    heard: Float
    seen: Float
    heard_offset: Float
    heard_scale: Float
    seen_offset: Float
    seen_scale: Float


def common_labels(spoken: Sequence[Spoken], fps: float) -> list[list[str]]:
    """One label a frame; phones with fewer than `LEAST_FRAMES` frames are called what they look like."""
    labels = [frame_phones(each.phones, len(each.counted), fps) for each in spoken]
    heard = np.concatenate([np.array(row)[each.counted] for row, each in zip(labels, spoken, strict=True)])
    often = {phone for phone in PHONES if (heard == phone).sum() >= LEAST_FRAMES}
    speech = often - {SILENCE} or set(heard) - {SILENCE}
    names = {phone: nearest_phone(phone, speech) for phone in PHONES}
    return [[names[label] for label in row] for row in labels]


def prepare(spoken: Sequence[Spoken], rest: Float, fps: float) -> Corpus:
    """Sentences with sound as a corpus; one of rest in silence is added where nobody is silent."""
    spoken = list(spoken)
    labels = common_labels(spoken, fps)
    if sum(row.count(SILENCE) for row in labels) < LEAST_FRAMES:
        count = 2 * LONGEST
        spoken.append(
            Spoken((), np.tile(rest, (count, 1)), np.ones(count, bool), Sound(np.zeros(RATE, np.float32), RATE))
        )
        labels.append([SILENCE] * count)
    counted = np.concatenate([each.counted for each in spoken])
    lengths = [len(each.counted) for each in spoken]
    heard = np.concatenate([
        each.sound.frames(length, fps) for each, length in zip(spoken, lengths, strict=True) if each.sound is not None
    ])  # fmt: skip
    seen = np.where(counted[:, None], np.concatenate([each.coefficients for each in spoken]), 0.0)
    starts = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    found = [(one[counted].mean(0), np.maximum(one[counted].std(0), 1e-6)) for one in (heard, seen)]
    standard = [(one - mean) / scale for one, (mean, scale) in zip((heard, seen), found, strict=True)]
    own = remove_means(standard[1], labels, starts, counted)
    rows = [np.asarray(each, np.float32) for each in (standard[0], own, *found[0], *found[1])]
    return Corpus(tuple(map(tuple, labels)), starts, counted, *rows)


def remove_means(seen: Array, labels: Sequence[Sequence[str]], starts: Index, counted: NDArray[np.bool_]) -> Array:
    """What each sentence has of its own (pose, light) taken off (3.2).

    Deena 2010 takes off a sentence's mean, whose sentences say much of everything. In ours the share of silence decides
    the mean, so that what is taken off is how the sentence's mean differs from that of its phones' means.

    Args:
        seen: (F, K).
        labels, starts, counted: see `Corpus`.
    """
    flat = np.array([label for row in labels for label in row])
    expected = np.zeros_like(seen)
    for label in np.unique(flat):
        these = flat == label
        if (these & counted).any():
            expected[these] = seen[these & counted].mean(0)
    result = seen.copy()
    for start, stop in pairwise(starts):
        inside = np.zeros(len(seen), bool)
        inside[start:stop] = counted[start:stop]
        if inside.any():
            result[start:stop] -= (seen[inside] - expected[inside]).mean(0)
    return result


def pieces(labels: Sequence[str], numbers: dict[str, int]) -> list[Stretch]:
    """Phone states: each run of one label, cut to at most `LONGEST` frames."""
    found: list[Stretch] = []
    for frame, label in enumerate(labels):
        state = numbers[label]
        if found and found[-1].state == state and frame - found[-1].start < LONGEST:
            found[-1] = found[-1]._replace(stop=frame + 1)
        else:
            found.append(Stretch(state, frame, frame + 1))
    return found


def phone_windows(corpus: Corpus, tokens: Sequence[str]) -> list[list[Index]]:
    """Of each phone state the frames of its pieces: numbers of frames that count."""
    numbers = {token: number for number, token in enumerate(tokens)}
    found: list[list[Index]] = [[] for _ in tokens]
    for labels, start in zip(corpus.labels, corpus.starts, strict=False):
        for state, first, stop in pieces(labels, numbers):
            found[state] += counted_runs(np.arange(start + first, start + stop), corpus.counted)
    return found


def counted_runs(frames: Index, counted: NDArray[np.bool_]) -> list[Index]:
    """Pieces of consecutive frames between those that do not count."""
    kept = frames[counted[frames]]
    if not len(kept):
        return []
    return np.split(kept, np.flatnonzero(np.diff(kept) > 1) + 1)


def vlmm_windows(corpus: Corpus, vlmm: Vlmm) -> list[list[Index]]:
    """Of each state the frames of its string, wherever the automaton is in the state (4.1); they may overlap.

    Where that gives too little, wherever the string is at all: there the automaton remembers more.
    """
    own: list[list[Index]] = [[] for _ in vlmm.contexts]
    anywhere: list[list[Index]] = [[] for _ in vlmm.contexts]
    for labels, start in zip(corpus.labels, corpus.starts, strict=False):
        for frame, reached in enumerate(vlmm.traverse(labels)):
            state = reached
            while state:
                window = np.arange(start + frame + 1 - len(vlmm.contexts[state]), start + frame + 1)
                if corpus.counted[window].all():
                    anywhere[state].append(window)
                    if state == reached:
                        own[state].append(window)
                state = vlmm.parent(state)
    return [few if enough(few) else all_of_them for few, all_of_them in zip(own, anywhere, strict=True)]


def enough(windows: Sequence[Index]) -> bool:
    """Whether a model can be trained on these."""
    return len(windows) >= LEAST_WINDOWS and sum(map(len, windows)) >= LEAST_FRAMES


def sample(windows: Sequence[Index], most: int) -> list[Index]:
    """Whole windows with at most that many frames in all (one window at least), evenly over the recording.

    The cost of a model grows with the cube of its frames.
    """
    count = max(1, int(most // np.mean([len(window) for window in windows])))
    while True:
        places = np.unique(np.linspace(0, len(windows) - 1, min(count, len(windows))).round().astype(int))
        chosen = [windows[place] for place in places]
        if count == 1 or sum(map(len, chosen)) <= most:
            return chosen
        count -= 1


@dataclass(frozen=True)
class Learnt:
    """A state's model and where its frames come from.

    Attributes:
        rows: (n,) numbers of frames in the corpus.
        begins: (n,) which of them begin a window.
        trained: the model.
    """

    rows: Index
    begins: NDArray[np.bool_]
    trained: Trained


def learn_states(
    corpus: Corpus, windows: Sequence[Sequence[Index]], *, most: int, steps: int, seed: int,
    progress: Callable[[float], None],
) -> list[Learnt | None]:  # fmt: skip
    """One shared Gaussian-process dynamical model for each state that has enough frames.

    Args:
        corpus: whose frames.
        windows: of each state (`vlmm_windows`, `phone_windows`).
        most: frames of a state at most (`sample`).
        steps: of the optimiser for each.
        seed: of the start.
        progress: told the share done.
    """
    return list(_learn(corpus, windows, most, steps, seed, progress))


def _learn(
    corpus: Corpus, windows: Sequence[Sequence[Index]], most: int, steps: int, seed: int,
    progress: Callable[[float], None],
) -> Iterator[Learnt | None]:  # fmt: skip
    for state, found in enumerate(windows):
        progress(state / len(windows))
        if not enough(found):
            yield None
            continue
        chosen = sample(found, most)
        rows = np.concatenate(chosen)
        begins = np.concatenate([np.arange(len(window)) == 0 for window in chosen])
        heard, seen = (pool[rows].astype(np.float64) for pool in (corpus.heard, corpus.seen))
        after = np.flatnonzero(~begins)
        likelihood = Likelihood(heard - heard.mean(0), seen - seen.mean(0), after - 1, after, np.flatnonzero(begins))
        yield Learnt(rows, begins, rounded(train(likelihood, steps=steps, rng=np.random.default_rng([seed, state]))))


def rounded(trained: Trained) -> Trained:
    """As it is stored: a model speaks alike before and after."""
    points, sound, sight = (
        each.astype(np.float32).astype(np.float64)
        for each in (trained.points, trained.sound_scale, trained.sight_scale)
    )
    return replace(trained, points=points, sound_scale=sound, sight_scale=sight)
