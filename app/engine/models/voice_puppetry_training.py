"""Training of Voice Puppetry (Brand 1999): expectation and maximisation over mouths, then the sounds of each state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

from app.engine.models.gpdm_corpus import Corpus, counted_runs, prepare
from app.engine.models.mfcc import COUNT
from app.engine.models.model import Spoken
from app.engine.models.voice_puppetry import Gaussians, VoicePuppetry, entropic, forward_backward, with_velocity
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack

Array = NDArray[np.float64]
Float = NDArray[np.float32]

PASSES = 20
"""Of expectation and maximisation."""
SIZES = (24, 48, 96)
"""Numbers of states that are tried on sentences left out."""
FRAMES_A_STATE = 20
"""Fewer on average: so many states are not tried."""
EVERY, PLACE = 6, 3
"""Of six sentences one is left out for that, the fourth."""


class VoicePuppetryKind:
    """See `app.engine.models.model.Kind`."""

    name = "voice-puppetry"
    version = 1
    hears = True
    least = 10.0

    def fit(
        self, spoken: Sequence[Spoken], rest: Float, *, fps: float, seed: int, progress: Callable[[float], None]
    ) -> VoicePuppetry:
        """The number of states chosen on every sixth sentence, then everything learnt from all."""
        kept = [each for place, each in enumerate(spoken) if place % EVERY != PLACE]
        frames = sum(int(each.counted.sum()) for each in spoken)
        sizes = [size for size in SIZES if size * FRAMES_A_STATE <= frames] or [SIZES[0]]
        best = sizes[0]
        if len(kept) < len(spoken) and len(sizes) > 1:
            first = prepare(kept, rest, fps)
            errors = []
            for number, size in enumerate(sizes):
                model = learn(first, rest, fps, size, seed)
                errors.append(_error(model, spoken[PLACE::EVERY]))
                progress((number + 1) / (len(sizes) + 1))
            best = sizes[int(np.argmin(errors))]
        model = learn(prepare(spoken, rest, fps), rest, fps, best, seed)
        progress(1.0)
        return model

    def load(self, stored: StoredArrays) -> VoicePuppetry:
        """From `VoicePuppetry.to_arrays`."""
        initial = stored.exact("initial", (-1,))
        transitions = stored.exact("transitions", (len(initial), len(initial)))
        rest = stored.numbers("rest", (-1,))
        found = [
            stored.exact(f"{stream}_{what}", (len(initial), 2 * size))
            for stream, size in (("sight", len(rest)), ("sound", COUNT))
            for what in ("mean", "variance")
        ]
        seen, heard = stored.numbers("seen", (2, len(rest))), stored.numbers("heard", (2, COUNT))
        chances = np.vstack([initial, transitions])
        if not (len(initial) and (chances >= 0).all() and np.allclose(chances.sum(1), 1.0)):
            raise BadPack(f"{stored.where}: the probabilities of the states are none")
        if not all((each > 0).all() for each in (found[1], found[3], seen[1], heard[1])):
            raise BadPack(f"{stored.where}: variances or scales of the states are not positive")
        return VoicePuppetry(
            initial, transitions, Gaussians(*found[:2]), Gaussians(*found[2:]), seen, heard, rest,
            float(stored.numbers("fps", (1,))[0]),
        )  # fmt: skip


def learn(corpus: Corpus, rest: Float, fps: float, states: int, seed: int) -> VoicePuppetry:
    """One model with so many states; those of k-means are where it begins.

    Args:
        corpus: whose frames.
        rest, fps: see `VoicePuppetry`.
        states: how many.
        seed: of k-means.
    """
    runs = [
        run for start, stop in pairwise(corpus.starts) for run in counted_runs(np.arange(start, stop), corpus.counted)
    ]
    sight = [with_velocity(corpus.seen[run].astype(np.float64)) for run in runs]
    sound = [with_velocity(corpus.heard[run].astype(np.float64)) for run in runs]
    together = np.concatenate(sight)
    _, label = kmeans2(together, states, iter=20, minit="++", rng=np.random.default_rng(seed))
    cuts = np.cumsum([len(each) for each in runs])[:-1]
    shares = np.split(np.eye(states)[label], cuts)
    first = np.ones(states) + sum(share[0] for share in shares)
    steps = sum((share[:-1].T @ share[1:] for share in shares), np.zeros((states, states)))
    gaussians = Gaussians.of(together, np.concatenate(shares))
    initial, transitions = first / first.sum(), entropic(steps)
    for _ in range(PASSES):
        found = [forward_backward(initial, transitions, gaussians.log_likelihood(rows)) for rows in sight]
        shares = [share for share, _, _ in found]
        gaussians = Gaussians.of(together, np.concatenate(shares))
        first = 1e-3 + sum(share[0] for share in shares)
        initial = first / first.sum()
        transitions = entropic(sum((step for _, step, _ in found), np.zeros((states, states))))
    heard = Gaussians.of(np.concatenate(sound), np.concatenate(shares))
    return VoicePuppetry(
        initial, transitions, gaussians, heard, np.array([corpus.seen_offset, corpus.seen_scale]),
        np.array([corpus.heard_offset, corpus.heard_scale]), np.asarray(rest, np.float32), fps,
    )  # fmt: skip


def _error(model: VoicePuppetry, spoken: Sequence[Spoken]) -> float:
    """Mean squared error in standard deviations."""
    errors = [
        ((model.predict((), len(each.counted), sound=each.sound) - each.coefficients) / model.seen[1])[each.counted]
        for each in spoken
    ]
    return float((np.concatenate(errors) ** 2).mean())
