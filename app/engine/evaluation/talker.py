"""The talker of a pack, known from the pack alone: where the face is, and how frames not seen before are read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from app.engine.background import Box
from app.engine.frame import planes
from app.engine.metrics import Window
from app.engine.mmm import MorphableModel
from app.engine.modes import MESH_STEP, Modes
from app.engine.pack import Pack
from app.engine.training.appearance import LOOKS, Looks
from app.engine.training.corpus import Corpus, Progress
from app.engine.training.em_pca import Components
from app.engine.training.face_tracker import template_of
from app.engine.training.fit_modes import Analysis, Weights, pulled_texture
from app.engine.training.frame_store import FrameStore
from app.engine.training.landmark_flow import Landmarks
from app.engine.training.layout import CROP, Layout, face_mask, importance, mouth_box, only_face
from app.engine.training.workers import in_parallel
from app.engine.trajectory import GaussianTrajectory

Float = NDArray[np.float32]

SIDES = 49
"""Sides of the face box that are tried between those that the crop's rounded size allows."""
AT_ONCE = 64
"""Frames read in one piece of work."""


def layout_of(pack: Pack) -> Layout:
    """Where things are in the pack's reference picture, which its `STILL` is.

    Raises:
        TrainingFailed: no face is found in it, or more than one.
    """
    still, crop = pack.background.pictures[-1], pack.background.crop
    luma = planes(still)[0]
    template = template_of(luma, only_face(luma, f"the still picture of {pack.manifest.id}"))
    return Layout(still, template, crop, side_of(pack.modes, crop))


def side_of(modes: Modes, crop: Box) -> float:
    """The side of the face box that a crop was laid out by: the unit of mask, importance and mouth box.

    The crop's size says it but for a pixel, since it was rounded. The modes say it better: they are orthonormal where
    errors count as they did in training, and the importance of pixels depends on the side.

    Args:
        modes: of the pack.
        crop: of the pack.
    """
    low = max((size - 1) / share for size, share in zip((crop.width, crop.height), CROP, strict=True))
    high = min((size + 1) / share for size, share in zip((crop.width, crop.height), CROP, strict=True))
    if low > high:  # the picture was smaller than the crop should be
        low = high = max(crop.width / CROP[0], crop.height / CROP[1])
    flows = modes.flow_modes.reshape(modes.flow_count, -1).astype(np.float64)

    def skew(side: float) -> float:
        weights = Weights.of(importance(crop, side)).flow
        weighted = (modes.flow_modes * weights).reshape(modes.flow_count, -1)
        return float(np.abs(weighted @ flows.T - np.eye(len(flows))).sum())

    return float(min(np.linspace(low, high, SIDES if high > low else 1), key=skew))


def common_of(pack: Pack) -> Float:
    """(P,) the mouth at rest, planes flattened: what passages of other recordings are registered to."""
    still, crop = pack.background.pictures[-1], pack.background.crop
    each = (crop.luma(still), *crop.chroma(still))
    return np.concatenate([plane.reshape(-1) for plane in each]).astype(np.float32)


@dataclass(frozen=True)
class Reader:
    """Reads frames: their flow from the reference prototype, and their mode coefficients.

    Attributes:
        modes: of the pack.
        looks: principal components of the prototypes' masked luma.
        landmarks: the prototypes. They read unseen frames as well as the hundreds of landmarks that training has.
        side: of the face box, see `side_of`.
    """

    modes: Modes
    looks: Looks
    landmarks: Landmarks
    side: float

    @cached_property
    def analysis(self) -> Analysis:
        """Projection with the importance that training used."""
        return Analysis(self.modes, self._weights)

    @cached_property
    def _weights(self) -> Weights:
        return Weights.of(importance(Box(0, 0, self.modes.width, self.modes.height), self.side))

    @cached_property
    def _exact(self) -> tuple[Float, Float]:
        """What makes the projections of flow and texture least squares for modes that are not quite orthonormal."""
        return tuple(
            np.linalg.inv((flat * weights).astype(np.float64) @ flat.T).astype(np.float32)
            for flat, weights in (
                (
                    self.modes.flow_modes.reshape(self.modes.flow_count, -1),
                    np.broadcast_to(self._weights.flow, (*self._weights.flow.shape[:2], 2)).reshape(-1),
                ),
                (self.modes.texture_modes, self._weights.texture),
            )
        )  # type: ignore[return-value]

    def flow(self, luma: NDArray[np.uint8] | Float) -> Float:
        """(H, W, 2) flow from the reference prototype to a crop's luma (H, W)."""
        picture = luma.astype(np.float32)
        components = self.looks.components
        look = (picture.ravel() * self.looks.mask.ravel() - components.mean) @ components.axes.T
        return self.landmarks.flow_to(picture, look.astype(np.float32))

    def flow_of(self, frame: NDArray[np.uint8]) -> Float:
        """(H, W, 2) flow from the reference prototype to a frame (P,)."""
        return self.flow(frame[: self.modes.width * self.modes.height].reshape(self.modes.height, self.modes.width))

    def coefficients(self, frame: NDArray[np.uint8], flow: Float) -> Float:
        """(K,) of a frame (P,) and the flow (H, W, 2) to it."""
        of_flow, of_texture = self._exact
        moved = of_flow @ self.analysis.flow(flow[::MESH_STEP, ::MESH_STEP])
        texture = of_texture @ self.analysis.texture(pulled_texture(self.modes, frame, moved))
        return np.concatenate([moved, texture]).astype(np.float32)


@dataclass(frozen=True)
class Talker:
    """What evaluation needs of a pack; small enough to travel between processes, the loop stays behind.

    Attributes:
        name: the avatar's.
        layout: of its reference picture.
        common: (P,) its mouth at rest.
        reader: of its talker's frames.
        modes, morphable, trajectory, trained_on: the pack's.
    """

    name: str
    layout: Layout
    common: Float
    reader: Reader
    modes: Modes
    morphable: MorphableModel
    trajectory: GaussianTrajectory
    trained_on: frozenset[str]

    @classmethod
    def of(cls, pack: Pack) -> Talker:
        """From a pack alone.

        Raises:
            TrainingFailed: see `layout_of`.
        """
        layout = layout_of(pack)
        return cls(
            pack.manifest.id, layout, common_of(pack), reader_of(pack, layout.side), pack.modes, pack.morphable,
            pack.trajectory, frozenset(pack.manifest.trained_on),
        )  # fmt: skip

    @property
    def window(self) -> Window:
        """Rows and columns of the crop that pictures are compared in."""
        return mouth_box(self.layout.crop, self.layout.side)


def reader_of(pack: Pack, side: float) -> Reader:
    """The reader that a pack's prototypes make."""
    model = pack.morphable
    mask = face_mask(pack.background.crop, side)
    luma = model.images[:, : model.width * model.height]
    masked = luma.astype(np.float64) * mask.ravel()
    mean = masked.mean(0)
    _, spread, axes = np.linalg.svd(masked - mean, full_matrices=False)
    kept = min(LOOKS, len(axes))
    components = Components(
        mean.astype(np.float32), axes[:kept].astype(np.float32), spread[:kept] ** 2 / len(masked)
    )  # fmt: skip
    space = ((masked - mean) @ axes[:kept].T).astype(np.float32)
    landmarks = Landmarks(
        luma.reshape(-1, model.height, model.width), space, model.flows.astype(np.float16), model.reference
    )
    return Reader(pack.modes, Looks(components, mask), landmarks, side)


def read(corpus: Corpus, reader: Reader, *, workers: int = 0, progress: Progress = lambda *_: None) -> Float:
    """(T, K) coefficients of a corpus; zero where nothing was to be seen (`Corpus.good`)."""
    good = np.flatnonzero(corpus.good)
    pieces = [good[start : start + AT_ONCE] for start in range(0, len(good), AT_ONCE)]
    found = in_parallel(
        partial(_read_some, frames=corpus.frames, reader=reader), pieces, workers=workers,
        progress=lambda share: progress("reading", share),
    )  # fmt: skip
    coefficients = np.zeros((len(corpus.frames), reader.modes.count), np.float32)
    for piece, rows in zip(pieces, found, strict=True):
        coefficients[piece] = rows
    return coefficients


def _read_some(numbers: NDArray[np.int64], frames: FrameStore, reader: Reader) -> Float:
    return np.stack([reader.coefficients(frame, reader.flow_of(frame)) for frame in frames.take(numbers)])
