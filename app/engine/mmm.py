"""The multidimensional morphable model to the letter: prototypes, flows, (alpha, beta) (Fu 2011, 3.3.2).

This is the reference: N forward warps a frame. It is the oracle of the tests and the baseline of the benchmark; what
serves is `app.engine.modes`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.background import Background, Planes, chroma_map
from app.engine.modes import MESH_STEP, Modes, split_texture
from app.engine.simplex import least_squares_on_simplex
from app.engine.warp import forward_warp, pixel_grid, sample

Float = NDArray[np.float32]


@dataclass(frozen=True)
class MorphableModel:
    """Prototypes and their flows.

    Attributes:
        width, height: of a prototype, pixels.
        images: (N, P) float32: luma, then both chroma planes at half resolution, flattened.
        flows: (N, H, W, 2) float32: C_i from the reference prototype to prototype i, pixels; zero for the reference.
        reference: index of the reference prototype.
    """

    width: int
    height: int
    images: Float
    flows: Float
    reference: int

    def synthesise(self, alpha: Float, beta: Float) -> Planes:
        """The morph of eq. 3.3 to 3.5: all N prototypes are warped, whatever their weight.

        Args:
            alpha: (N,) shape.
            beta: (N,) appearance; blends add up to the prototypes' brightness if it sums to 1.
        """
        width, height = self.width, self.height
        flow = np.tensordot(alpha, self.flows, 1).astype(np.float32)  # C_1^synth = sum alpha_i C_i
        half_flow = halve_flow(flow)
        luma = np.zeros((height, width, 1), np.float32)
        chroma = np.zeros((height // 2, width // 2, 2), np.float32)
        warped, warped_half = np.empty_like(luma), np.empty_like(chroma)
        turned, turned_half = np.empty_like(flow), np.empty_like(half_flow)
        hit = np.empty((height, width), np.bool_)
        hit_half = np.empty((height // 2, width // 2), np.bool_)
        for image, prototype_flow, half_prototype_flow, weight in zip(
            self.images, self.flows, self.half_flows, beta, strict=True
        ):
            planes = split_texture(image, width, height)
            forward_warp(flow - prototype_flow, prototype_flow, turned, hit)  # eq. 3.3
            forward_warp(planes.luma[..., None], turned, warped, hit)  # eq. 3.4
            luma += weight * warped  # eq. 3.5
            forward_warp(half_flow - half_prototype_flow, half_prototype_flow, turned_half, hit_half)
            forward_warp(np.stack([planes.blue - 128, planes.red - 128], -1), turned_half, warped_half, hit_half)
            chroma += weight * warped_half  # about 128, so that weights which do not sum to 1 keep the hue
        return Planes(luma[..., 0], chroma[..., 0] + np.float32(128), chroma[..., 1] + np.float32(128))

    half_flows: Float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "half_flows", np.stack([halve_flow(flow) for flow in self.flows]))


def halve_flow(flow: Float) -> Float:
    """A flow for planes of half the resolution."""
    size = (flow.shape[1] // 2, flow.shape[0] // 2)
    return (cv2.resize(flow, size, interpolation=cv2.INTER_AREA) * 0.5).astype(np.float32)


class Conversion:
    """Mode coefficients to (alpha, beta).

    The modes' texture grid is the reference prototype's, so both forms describe the same flow and the same texture:
    alpha is a ridge-regularised least-squares fit of the flow by the prototypes' flows, beta one of the texture by the
    prototypes' textures with beta >= 0 and sum 1 (Ezzat 2002).
    """

    def __init__(self, model: MorphableModel, modes: Modes) -> None:
        self._modes = modes
        learnt = (modes.flow_modes != 0).any((0, 3))  # elsewhere the modes say nothing of the flow
        self._gain = alpha_gain(model.flows[:, ::MESH_STEP, ::MESH_STEP] * learnt[..., None])
        textures = (common_textures(model) - modes.texture_mean).astype(np.float64)
        axes = modes.texture_modes.astype(np.float64)
        used = (modes.texture_modes != 0).any(0)
        self._axes = np.linalg.solve(axes[:, used] @ axes[:, used].T, axes[:, used] @ textures[:, used].T).T
        self._gram = self._axes @ self._axes.T

    def __call__(self, coefficients: Float) -> tuple[Float, Float]:
        """(alpha (N,), beta (N,)) of one mouth (K,).

        Distances of textures are those of their mode coefficients: modes are orthonormal where errors count.
        """
        alpha = self._gain @ (self._modes.flow(coefficients)).reshape(-1)
        target = np.asarray(self._axes @ coefficients[self._modes.flow_count :], np.float64)
        return alpha.astype(np.float32), least_squares_on_simplex(self._gram, target).astype(np.float32)


def alpha_gain(flows: Float) -> NDArray[np.float64]:
    """(N, F) matrix that takes a flattened flow to the alpha fitting it, with a ridge of 1e-4 trace / N.

    Args:
        flows: (N, h, w, 2) of the prototypes; the reference's is zero and gets alpha 0.
    """
    flat = flows.reshape(len(flows), -1).astype(np.float64)
    gram = flat @ flat.T
    return np.linalg.solve(gram + 1e-4 * np.trace(gram) / len(flat) * np.eye(len(flat)), flat)


def common_textures(model: MorphableModel) -> Float:
    """(N, P): every prototype's image, pulled onto the reference's grid by its own flow."""
    return np.stack(
        [
            pull(split_texture(image, model.width, model.height), flow)
            for image, flow in zip(model.images, model.flows, strict=True)
        ]
    )


def pull(image: Planes, flow: Float) -> Float:
    """(P,) flattened planes with image(p + flow(p)) at p."""
    height, width = image.luma.shape
    where = flow + pixel_grid(width, height)
    half = chroma_map(where)
    return np.concatenate(
        [sample(plane, points).ravel() for plane, points in zip(image.each(), (where, half, half), strict=True)]
    )


class MorphMouth:
    """Draws mouths by the morphable model itself, then moves them to the head's pose (a second interpolation)."""

    def __init__(self, model: MorphableModel, modes: Modes, background: Background) -> None:
        self._model = model
        self._convert = Conversion(model, modes)
        self._background = background
        self._last: tuple[bytes, Planes] = (b"", Planes.empty(0, 0))

    def draw(self, coefficients: Float, index: int, out: Planes) -> None:
        """See `app.engine.background.Mouth`."""
        key = coefficients.tobytes()
        known, morph = self._last
        if known != key:  # the mouth at rest is drawn once, not once for every frame of the loop
            morph = self._model.synthesise(*self._convert(coefficients))
            self._last = (key, morph)
        where = self._background.backward(index)
        half = chroma_map(where)
        for source, target, points in zip(morph.each(), out.each(), (where, half, half), strict=True):
            sample(source, points, out=target)
