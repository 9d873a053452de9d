"""How errors of mouth coefficients look, so that networks are trained on what is seen.

Flow and texture do not add up in a picture: the same error of a texture counts little where the mouth is shut. A small
perceptron learns, on mouths drawn by the avatar's modes, what components of the picture coefficients make; being
smooth, it hands errors of the picture back to the coefficients, as drawing does not. It is used in training only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.utils.extmath import randomized_svd

from app.engine.models.model import Spoken
from app.engine.models.network_layers import Adam, Weights
from app.engine.modes import Modes, draw_crop

Float = NDArray[np.float32]

COMPONENTS = 60
"""Of the pictures, as many as models are scored by."""
DRAWN, ANALYSED = 16_000, 2000
"""Mouths that are drawn, and those of them that the components are learnt from."""
HIDDEN, EPOCHS, BATCH, RATE, DECAY = 192, 25, 128, 2e-3, 1e-4
EVENNESS = 0.1
"""Components count by this power of their variance: 1 as pixels do, 0 all alike."""


@dataclass(frozen=True)
class Pictures:
    """Components of pictures as a function of standardised coefficients.

    Attributes:
        weights: of the perceptron: tanh twice, and a linear part beside it.
        importance: (C,) of the components, 1 on average.
    """

    weights: Weights
    importance: Float

    def components(self, x: Float) -> tuple[Float, Float, Float]:
        """(n, C) of coefficients (n, K), and what `slope` needs of both layers."""
        w = self.weights
        first: Float = np.tanh(x @ w["w0"] + w["b0"])
        second: Float = np.tanh(first @ w["w1"] + w["b1"])
        shown: Float = second @ w["w2"] + x @ w["w"] + w["b"]
        return shown, first, second

    def slope(self, outer: Float, first: Float, second: Float) -> tuple[Float, Float, Float]:
        """(n, K) gradient in the coefficients, from that in the components; and those in front of both layers."""
        w = self.weights
        inner: Float = (outer @ w["w2"].T) * (1 - second**2)
        start: Float = (inner @ w["w1"].T) * (1 - first**2)
        back: Float = start @ w["w0"].T + outer @ w["w"].T
        return back, start, inner

    @property
    def seen(self) -> Float:
        """(K,) how much is seen of each coefficient, 1 on average."""
        found = np.square(self.weights["w"]).sum(1)
        return np.asarray(found / found.mean(), np.float32)


def learn_pictures(spoken: Sequence[Spoken], standard: tuple[Float, Float], modes: Modes, seed: int) -> Pictures:
    """Draw mouths of a recording, and mouths between them, and learn what they look like.

    Args:
        spoken: sentences.
        standard: (K,) mean and deviation of coefficients.
        modes: that draw.
        seed: of everything random.
    """
    random = np.random.default_rng(seed)
    rows = np.concatenate([each.coefficients[each.counted] for each in spoken])
    near, far = (rows[random.integers(len(rows), size=DRAWN)] for _ in range(2))
    share = np.where(np.arange(DRAWN) % 2, random.random(DRAWN), 0).astype(np.float32)[:, None]
    mouths = near + share * (np.where(np.arange(DRAWN)[:, None] % 4 == 1, far, standard[0]) - near)
    luma = np.stack([draw_crop(modes, mouth).luma.ravel() for mouth in mouths[:ANALYSED]])
    mean = luma.mean(0)
    _, _, axes = randomized_svd(luma - mean, min(COMPONENTS, *luma.shape), random_state=seed)
    shown = [(luma - mean) @ axes.T]
    shown += [(draw_crop(modes, mouth).luma.ravel() - mean)[None] @ axes.T for mouth in mouths[ANALYSED:]]
    drawn = np.concatenate(shown)
    deviation = np.maximum(drawn.std(0), 1e-6)
    importance = deviation ** (2 * EVENNESS)
    weights = _fitted(
        ((mouths - standard[0]) / standard[1]).astype(np.float32), (drawn / deviation).astype(np.float32), random
    )
    return Pictures(weights, (importance / importance.mean()).astype(np.float32))


def _fitted(x: Float, wanted: Float, random: np.random.Generator) -> Weights:
    """The perceptron that turns `x` (n, K) into `wanted` (n, C)."""
    linear = np.linalg.lstsq(np.c_[x, np.ones(len(x))].astype(np.float64), wanted, rcond=None)[0].astype(np.float32)

    def normal(count: int, out: int, gain: float) -> Float:
        return np.asarray(random.standard_normal((count, out)) * gain / np.sqrt(count), np.float32)

    weights: Weights = {
        "w0": normal(x.shape[1], HIDDEN, 1.0), "b0": np.zeros(HIDDEN, np.float32),
        "w1": normal(HIDDEN, HIDDEN, 1.0), "b1": np.zeros(HIDDEN, np.float32),
        "w2": normal(HIDDEN, wanted.shape[1], 0.03), "w": linear[:-1], "b": linear[-1],
    }  # fmt: skip
    net = Pictures(weights, np.ones(wanted.shape[1], np.float32))
    optimiser = Adam(weights, DECAY)
    steps = EPOCHS * -(-len(x) // BATCH)
    step = 0
    for _ in range(EPOCHS):
        order = random.permutation(len(x))
        for start in range(0, len(x), BATCH):
            chosen = order[start : start + BATCH]
            shown, first, second = net.components(x[chosen])
            outer = (shown - wanted[chosen]) / np.float32(len(chosen))
            _, early, late = net.slope(outer, first, second)
            gradients = {
                "w0": x[chosen].T @ early, "b0": early.sum(0), "w1": first.T @ late, "b1": late.sum(0),
                "w2": second.T @ outer, "w": x[chosen].T @ outer, "b": outer.sum(0),
            }  # fmt: skip
            optimiser.step(weights, gradients, float(RATE * 0.5 * (1 + np.cos(np.pi * step / steps))))
            step += 1
    return weights
