"""A small causal convolutional network, and its gradients, in numpy.

Trained here because it is so small: a frame costs some hundred thousand multiplications, and a recording has some ten
thousand frames, so that a minute on one core is enough and no training library of hundreds of megabytes is needed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float32]
Weights = dict[str, Float]

WIDTH = 5
"""Frames that one convolution sees: its own and those before it."""
CONVOLUTIONS = 2
PAST = CONVOLUTIONS * (WIDTH - 1)
"""Frames before the first whose features are needed for it to be complete."""


def random_weights(features: int, hidden: int, out: int, random: np.random.Generator) -> Weights:
    """Small random ones, so that at first little is said and nothing is saturated (He 2015)."""

    def normal(rows: int, columns: int, gain: float) -> Float:
        return np.asarray(random.standard_normal((rows, columns)) * gain / np.sqrt(rows), np.float32)

    weights = {"w0": normal(features, hidden, 1.4), "b0": np.zeros(hidden, np.float32)}
    for layer in range(1, CONVOLUTIONS + 1):
        weights |= {f"w{layer}": normal(WIDTH * hidden, hidden, 0.7), f"b{layer}": np.zeros(hidden, np.float32)}
    return weights | {"w": normal(hidden, out, 0.3), "b": np.zeros(out, np.float32)}


@dataclass
class Pass:
    """What a forward pass leaves for the backward pass.

    Attributes:
        out: (B, T, K) what the network says.
        inputs: of each layer, as rows of a product.
        before: of each layer, in front of its rectifier.
        masks: (B, 1, H) of each layer: units switched off, the others louder; 1 for none.
    """

    out: Float
    inputs: list[Float] = field(default_factory=list)
    before: list[Float] = field(default_factory=list)
    masks: list[Float] = field(default_factory=list)


def forward(weights: Weights, x: Float, *, drop: float = 0.0, random: np.random.Generator | None = None) -> Pass:
    """h0 = relu(x w0 + b0); h_l = h_(l-1) + relu(conv(h_(l-1)) + b_l); y = h w + b.

    Args:
        weights: see `random_weights`.
        x: (B, T, F). Before its first frame there are zeros: the first `PAST` frames that come out are not complete.
        drop: share of units that are switched off, for a whole sequence.
        random: chooses them.
    """
    batch, frames, _ = x.shape
    done = Pass(np.zeros(0, np.float32))
    hidden = np.zeros(0, np.float32)
    for layer in range(CONVOLUTIONS + 1):
        rows = (_unfold(hidden) if layer else x).reshape(batch * frames, -1)
        before = rows @ weights[f"w{layer}"] + weights[f"b{layer}"]
        mask = np.ones((1, 1, 1), np.float32)
        if random is not None and drop:
            mask = (random.random((batch, 1, before.shape[1])) >= drop).astype(np.float32) / np.float32(1 - drop)
        moved = np.maximum(before, 0).reshape(batch, frames, -1) * mask
        hidden = hidden + moved if layer else moved
        done.inputs.append(rows)
        done.before.append(before)
        done.masks.append(mask)
    rows = hidden.reshape(batch * frames, -1)
    done.inputs.append(rows)
    done.out = (rows @ weights["w"] + weights["b"]).reshape(batch, frames, -1)
    return done


def backward(weights: Weights, done: Pass, slope: Float) -> Weights:
    """Gradients of all weights, from those of what was said (B, T, K)."""
    batch, frames, out = slope.shape
    rows = slope.reshape(-1, out)
    gradients = {"w": done.inputs[-1].T @ rows, "b": rows.sum(0)}
    hidden = (rows @ weights["w"].T).reshape(batch, frames, -1)
    for layer in range(CONVOLUTIONS, -1, -1):
        moved = (hidden * done.masks[layer]).reshape(batch * frames, -1) * (done.before[layer] > 0)
        gradients |= {f"w{layer}": done.inputs[layer].T @ moved, f"b{layer}": moved.sum(0)}
        if layer:
            hidden = hidden + _fold(np.asarray(moved @ weights[f"w{layer}"].T).reshape(batch, frames, WIDTH, -1))
    return gradients


def _unfold(hidden: NDArray[Any]) -> Float:
    """(B, T, WIDTH * H): every frame behind those before it."""
    frames = hidden.shape[1]
    padded = np.pad(hidden, ((0, 0), (WIDTH - 1, 0), (0, 0)))
    return np.concatenate([padded[:, at : at + frames] for at in range(WIDTH)], 2)


def _fold(slope: NDArray[Any]) -> Float:
    """The transpose of `_unfold`, from (B, T, WIDTH, H)."""
    batch, frames, _, count = slope.shape
    padded = np.zeros((batch, frames + WIDTH - 1, count), slope.dtype)
    for at in range(WIDTH):
        padded[:, at : at + frames] += slope[:, :, at]
    return padded[:, WIDTH - 1 :]


class Adam:
    """Adam with decoupled weight decay (Loshchilov 2019); biases do not decay."""

    def __init__(self, weights: Weights, decay: float) -> None:
        self._decay = decay
        self._first = {name: np.zeros_like(each) for name, each in weights.items()}
        self._second = {name: np.zeros_like(each) for name, each in weights.items()}
        self._step = 0

    def step(self, weights: Weights, gradients: Weights, rate: float) -> None:
        """Move all weights, in place."""
        self._step += 1
        fade, settle = np.float32(1 - 0.9**self._step), np.float32(1 - 0.99**self._step)
        for name, each in weights.items():
            first, second, slope = self._first[name], self._second[name], gradients[name]
            first += np.float32(0.1) * (slope - first)
            second += np.float32(0.01) * (slope * slope - second)
            if each.ndim > 1:
                each *= np.float32(1 - rate * self._decay)
            each -= np.float32(rate) * (first / fade) / (np.sqrt(second / settle) + np.float32(1e-8))
