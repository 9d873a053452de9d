"""The kinds `vlmm-gpdm` and `phone-gpdm`: training with settings that are fixed, and reading what was stored."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.engine.models.gpdm import Part, Scaling, SwitchingGpdm, low_passed
from app.engine.models.gpdm_corpus import (
    LONGEST,
    Corpus,
    Learnt,
    learn_states,
    phone_windows,
    prepare,
    vlmm_windows,
)
from app.engine.models.gpdm_training import LATENT
from app.engine.models.mfcc import COUNT
from app.engine.models.model import Spoken
from app.engine.models.vlmm import START, Vlmm, learn_vlmm
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack
from app.speech import PHONES, SILENCE

Float = NDArray[np.float32]

INFORMATION = 5.0
"""Nats by which a longer context must tell all its frames' next labels better: epsilon of eq. 13 times all frames."""
STEPS = 15
"""Of the optimiser; more fit the frames of small states too well, and sentences that were left out worse."""
EVERY, PLACE = 6, 3
"""Of six sentences one is left out to learn the gain, the fourth."""


class PhoneGpdmKind:
    """See `app.engine.models.model.Kind`; one state for each phone (Deena 2010's baseline)."""

    name = "phone-gpdm"
    version = 1
    hears = True
    least = 10.0
    most = 200
    """Frames that a state learns from."""

    def fit(
        self, spoken: Sequence[Spoken], rest: Float, *, fps: float, seed: int, progress: Callable[[float], None]
    ) -> SwitchingGpdm:
        """Twice: without every sixth sentence to learn the gain, then with all."""
        gain = np.ones((2, len(rest)), np.float32)
        kept = [each for place, each in enumerate(spoken) if place % EVERY != PLACE]
        corpus = prepare(spoken, rest, fps)
        if len(kept) < len(spoken):
            first = self.learn(prepare(kept, rest, fps), rest, fps, seed, lambda done: progress(0.4 * done))
            gain = learn_gain(first, spoken[PLACE::EVERY], progress=lambda done: progress(0.4 + 0.1 * done))
        model = self.learn(corpus, rest, fps, seed, lambda done: progress(0.5 + 0.5 * done))
        progress(1.0)
        return replace(model, gain=gain)

    def learn(
        self, corpus: Corpus, rest: Float, fps: float, seed: int, progress: Callable[[float], None]
    ) -> SwitchingGpdm:
        """From a whole corpus, with the paper's gain of 1."""
        tokens = tuple(phone for phone in PHONES if any(phone in labels for labels in corpus.labels))
        vlmm = self.automaton(corpus)
        windows = phone_windows(corpus, tokens) if vlmm is None else vlmm_windows(corpus, vlmm)
        learnt = learn_states(corpus, windows, most=self.most, steps=STEPS, seed=seed, progress=progress)
        return assemble(self.name, tokens, vlmm, corpus, learnt, rest, fps)

    def automaton(self, corpus: Corpus) -> Vlmm | None:
        """What says which state a frame is in."""
        del corpus
        return None

    def load(self, stored: StoredArrays) -> SwitchingGpdm:
        """From `SwitchingGpdm.to_arrays`."""
        return load_gpdm(self.name, stored)


class VlmmGpdmKind(PhoneGpdmKind):
    """The same with the states of a variable-length Markov model (Deena 2010's own)."""

    name = "vlmm-gpdm"
    most = 90

    def automaton(self, corpus: Corpus) -> Vlmm | None:
        return learn_vlmm(corpus.labels, memory=LONGEST, threshold=INFORMATION / len(corpus.counted))


def assemble(
    name: str, tokens: tuple[str, ...], vlmm: Vlmm | None, corpus: Corpus, learnt: Sequence[Learnt | None],
    rest: Float, fps: float,
) -> SwitchingGpdm:  # fmt: skip
    """A model from what was learnt; keeps the frames that are used."""
    used = np.unique(np.concatenate([each.rows for each in learnt if each is not None]))
    parts = tuple(
        None if each is None else Part(
            np.searchsorted(used, each.rows), each.begins, each.trained.points.astype(np.float32),
            np.array([*each.trained.sound, *each.trained.sight]),
            np.concatenate([each.trained.sound_scale, each.trained.sight_scale]).astype(np.float32),
        )
        for each in learnt
    )  # fmt: skip
    scaling = Scaling(corpus.heard_offset, corpus.heard_scale, corpus.seen_offset, corpus.seen_scale)
    return SwitchingGpdm(
        name, tokens, vlmm, parts, corpus.heard[used], corpus.seen[used], scaling,
        np.ones((2, len(rest)), np.float32), np.asarray(rest, np.float32), fps,
    )  # fmt: skip


def learn_gain(model: SwitchingGpdm, spoken: Sequence[Spoken], *, progress: Callable[[float], None]) -> Float:
    """(2, K) `SwitchingGpdm.gain` by least squares on sentences that the model was not trained on, within 0 to 1."""
    held = prepare(spoken, model.rest, model.fps)
    scaling = model.scaling
    between, within, true = [], [], []
    for number, each in enumerate(spoken):
        if each.sound is None:
            continue
        labels = held.labels[number]
        known = [label if label in model.tokens else SILENCE for label in labels]
        heard = (each.sound.frames(len(labels), model.fps) - scaling.heard_offset) / scaling.heard_scale
        mouths, centres = model.mouths(known, heard.astype(np.float64), None)
        kept = each.counted & (np.array(known) == np.array(labels))
        between.append(low_passed(centres)[kept])
        within.append(low_passed(mouths - centres)[kept])
        true.append(((each.coefficients - scaling.seen_offset) / scaling.seen_scale)[kept])
        progress((number + 1) / len(spoken))
    moves = np.stack([np.concatenate(between), np.concatenate(within)])
    inner = np.einsum("itk,jtk->kij", moves, moves) + 1e-6 * np.eye(2)
    outer = np.einsum("itk,tk->ki", moves, np.concatenate(true))
    return np.clip(np.linalg.solve(inner, outer[..., None])[..., 0].T, 0.0, 1.0).astype(np.float32)


def load_gpdm(name: str, stored: StoredArrays) -> SwitchingGpdm:
    """A model from its arrays.

    Raises:
        BadPack: they are not what they should be.
        KeyError: one is missing.
    """
    tokens = stored.names("tokens")
    if SILENCE not in tokens or len(tokens) < 2 or not set(tokens) <= set(PHONES):
        raise BadPack(f"{stored.where}: the phones are not ARPAbet with silence")
    rest = stored.numbers("rest", (-1,))
    heard, seen = stored.numbers("heard", (-1, COUNT)), stored.numbers("seen", (-1, len(rest)))
    counts = stored.exact("state_frames", (-1,)).astype(np.int64)
    total, there = int(counts.sum()), int((counts > 0).sum())
    rows = stored.exact("rows", (total,)).astype(np.int64)
    begins = stored.exact("begins", (total,)) > 0
    points = stored.numbers("points", (total, LATENT))
    kernels = stored.exact("kernels", (there, 8))
    scales = stored.numbers("scales", (there, COUNT + len(rest)))
    heard_scaling = stored.numbers("heard_scaling", (2, COUNT))
    seen_scaling = stored.numbers("seen_scaling", (2, len(rest)))
    fps = float(stored.numbers("fps", (1,))[0])
    vlmm = load_vlmm(tokens, stored) if "contexts" in stored.arrays else None
    firsts = (np.cumsum(counts) - counts)[counts > 0]
    sound = len(counts) == (len(tokens) if vlmm is None else len(vlmm.contexts)) and (counts >= 0).all()
    sound = sound and total > 0 and len(heard) == len(seen) and rows.min() >= 0 and rows.max() < len(heard)
    if not (sound and begins[firsts].all() and (vlmm is not None or (counts > 0).all())):
        raise BadPack(f"{stored.where}: frames and states of the dynamical models do not belong together")
    if vlmm is not None and not (counts[[vlmm.number[token,] for token in tokens]] > 0).all():
        raise BadPack(f"{stored.where}: a phone has no dynamical model")
    if not (
        (kernels > 0).all() and (scales > 0).all() and (heard_scaling[1] > 0).all() and (seen_scaling[1] > 0).all()
    ):
        raise BadPack(f"{stored.where}: kernels or scales of the dynamical models are not positive")
    split = np.split(np.arange(total), np.cumsum(counts)[:-1])
    numbers = np.cumsum(counts > 0) - 1
    parts = tuple(
        Part(rows[own], begins[own], points[own], kernels[number], scales[number]) if len(own) else None
        for own, number in zip(split, numbers, strict=True)
    )
    return SwitchingGpdm(
        name, tokens, vlmm, parts, heard, seen, Scaling(*heard_scaling, *seen_scaling),
        stored.numbers("gain", (2, len(rest))), rest, fps,
    )  # fmt: skip


def load_vlmm(tokens: tuple[str, ...], stored: StoredArrays) -> Vlmm:
    """The automaton of a model's arrays; raises as `load_gpdm` does."""
    contexts = tuple(tuple(context.split()) for context in stored.names("contexts"))
    following = stored.exact("next", (len(contexts), len(tokens)))
    strings = set(contexts)
    closed = all(each[1:] in strings and each[:-1] in strings for each in strings - {START})
    single = all((token,) in strings for token in tokens)
    known = all(set(each) <= set(tokens) for each in strings)
    if not (contexts and contexts[0] == START and len(strings) == len(contexts) and closed and single and known):
        raise BadPack(f"{stored.where}: the states of the Markov model are not those of an automaton")
    if (following < 0).any():
        raise BadPack(f"{stored.where}: probabilities of the Markov model are negative")
    return Vlmm(contexts, tokens, following)
