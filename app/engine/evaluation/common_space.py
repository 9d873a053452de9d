"""One space in which all trajectories are scored, whatever space a model works in: components of the mouth's pixels.

60 principal components of a talker's mouths, luma weighted by importance, in standard deviations of the recording that
they were learnt from. Recorded frames are projected; what a model says is drawn first, by the renderer, and then
projected: the space knows nothing of flows, textures or coefficients.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.engine.modes import Modes, draw_crop
from app.engine.training.corpus import Corpus
from app.engine.training.em_pca import em_pca
from app.engine.training.frame_store import BLOCK, FrameStore
from app.engine.training.layout import importance

Float = NDArray[np.float32]

COMPONENTS = 60
"""As many as Wang 2010 has eigen-lips in section 4.1."""
LEAST_MOVING = 1e-3
"""Of the first component's deviation: a component that moves less is none."""


@dataclass(frozen=True)
class CommonSpace:
    """Principal components of a talker's mouths.

    Attributes:
        root: (P,) square root of each luma pixel's importance.
        mean: (P,) of the weighted pixels.
        axes: (C, P) unit length.
        scale: (C,) standard deviation of each component over the recording, each passage moved to one mouth at rest.
    """

    root: Float
    mean: Float
    axes: Float
    scale: Float

    def of(self, luma: NDArray[np.uint8] | Float) -> Float:
        """(n, C) of crops' luma (n, P) or (n, h, w)."""
        weighted = luma.reshape(len(luma), -1).astype(np.float32) * self.root
        return np.asarray(((weighted - self.mean) @ self.axes.T) / self.scale, np.float32)

    def of_frames(self, frames: FrameStore, numbers: NDArray[np.int64]) -> Float:
        """(n, C) of recorded frames of these numbers."""
        found = [
            self.of(frames.take(numbers[start : start + BLOCK])[:, : len(self.root)])
            for start in range(0, len(numbers), BLOCK)
        ]
        return np.concatenate(found) if found else np.zeros((0, len(self.scale)), np.float32)

    def of_mouths(self, coefficients: Float, modes: Modes) -> Float:
        """(n, C) of mode coefficients (n, K), drawn.

        Where a passage's mouth at rest differs from the common one, add its offset first (`rest_offset`): flow and
        texture do not add up in pixels, so that what a passage has of its own cannot be taken from its pictures.
        """
        found = [
            self.of(np.stack([draw_crop(modes, row).luma for row in coefficients[start : start + BLOCK]]))
            for start in range(0, len(coefficients), BLOCK)
        ]
        return np.concatenate(found) if found else np.zeros((0, len(self.scale)), np.float32)


def learn_common_space(corpus: Corpus, *, count: int = COMPONENTS, seed: int = 0) -> CommonSpace:
    """The components of a recording's good frames.

    Args:
        corpus: whose frames.
        count: C at most.
        seed: of the start of EM-PCA.
    """
    root = np.sqrt(importance(corpus.crop, corpus.layout.side)).ravel().astype(np.float32)
    good = np.flatnonzero(corpus.good)

    def blocks() -> Iterator[Float]:
        for block in corpus.frames.blocks(good):
            yield block[:, : len(root)].astype(np.float32) * root

    found = em_pca(blocks, min(count, len(good) - 1), seed=seed)
    space = CommonSpace(root, found.mean, found.axes, np.ones(len(found.axes), np.float32))
    shown = np.zeros((len(corpus.good), len(found.axes)), np.float32)
    shown[good] = space.of_frames(corpus.frames, good)
    passages = [np.arange(each.frames.start, each.frames.stop) for each in corpus.passages]
    rests = resting_means(shown, passages, corpus.rest & corpus.good)
    common = np.mean([each for each in rests if each is not None], axis=0)
    for numbers, rest in zip(passages, rests, strict=True):
        shown[numbers] -= 0 if rest is None else rest - common
    scale = shown[good].std(0)
    moving = scale > LEAST_MOVING * scale.max()  # what is left of few or still pictures are rounding errors
    return replace(space, axes=space.axes[moving], scale=scale[moving].astype(np.float32))


def resting_means(
    shown: Float, passages: Sequence[NDArray[np.int64]], resting: NDArray[np.bool_]
) -> list[Float | None]:
    """(C,) mean of each passage's resting frames; None for those that do not rest."""
    found: list[Float | None] = []
    for numbers in passages:
        at_rest = numbers[resting[numbers]]
        found.append(shown[at_rest].mean(0) if len(at_rest) else None)
    return found
