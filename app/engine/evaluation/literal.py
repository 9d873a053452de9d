"""Frames read into the (alpha, beta) of the paper, and the prototypes as a serving form (Fu 2011, 3.2 and 3.3.2).

The literal model warps every prototype for every frame; its fast form has the prototypes' flows and textures for modes
and is drawn like any other modes. Both show the same mouths, which is what makes the serving form trustworthy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.engine.mmm import MorphableModel, pull
from app.engine.modes import MESH_STEP, Modes, split_texture
from app.engine.simplex import least_squares_on_simplex

Float = NDArray[np.float32]
Array = NDArray[np.float64]

RIDGE = 1e-4
"""Of alpha, in mean squared lengths of the prototypes' flows."""


class LiteralReader:
    """From frames and their flows to (alpha, beta) by weighted least squares.

    Args:
        model: prototypes and flows.
        importance: (H, W) how much an error of each pixel counts.
        textures: (N, P) of the prototypes on the reference's grid (`app.engine.mmm.common_textures`).
    """

    def __init__(self, model: MorphableModel, importance: Float, textures: Float) -> None:
        self._model = model
        weight = importance.astype(np.float64)
        flat = model.flows.reshape(len(model.flows), -1).astype(np.float64)
        weighted = (model.flows * weight[..., None]).reshape(len(flat), -1)
        gram = weighted @ flat.T
        ridge = RIDGE * np.trace(gram) / len(flat) * np.eye(len(flat))
        self._gain = np.linalg.solve(gram + ridge, weighted)
        self._flows = flat.astype(np.float32)
        luma = textures[:, : weight.size].astype(np.float64)
        self._blend = luma * weight.ravel()
        self._gram = self._blend @ luma.T

    def __call__(self, frame: NDArray[np.uint8], flow: Float) -> tuple[Float, Float]:
        """(alpha (N,), beta (N,)) of a frame (P,) and the flow (H, W, 2) from the reference to it.

        Alpha is a ridge-regularised fit of the flow by the prototypes' flows. The frame is then seen through the flow
        that alpha gives, and beta, not negative and with sum 1, fits the prototypes' textures to it (Ezzat 2002).
        """
        alpha = self._gain @ flow.reshape(-1).astype(np.float64)
        height, width = flow.shape[:2]
        shown = (alpha.astype(np.float32) @ self._flows).reshape(flow.shape)
        pulled = pull(split_texture(frame.astype(np.float32), width, height), shown)[: height * width]
        beta = least_squares_on_simplex(self._gram, self._blend @ pulled.astype(np.float64))
        return alpha.astype(np.float32), beta.astype(np.float32)


def prototype_modes(model: MorphableModel, textures: Float, layer: Float) -> Modes:
    """The fast form of the literal model: coefficients are (alpha, beta).

    Args:
        model: prototypes and flows.
        textures: (N, P) of the prototypes on the reference's grid.
        layer: of the serving modes, whose texture grid is the same.
    """
    pixels = textures.shape[1]
    return Modes(
        model.width, model.height, np.zeros((*layer.shape, 2), np.float32),
        np.ascontiguousarray(model.flows[:, ::MESH_STEP, ::MESH_STEP]), np.zeros(pixels, np.float32),
        textures.astype(np.float32), layer, np.zeros(pixels, np.float32),
    )  # fmt: skip
