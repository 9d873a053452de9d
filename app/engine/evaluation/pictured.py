"""Mouths drawn by any renderer at the recording's rest pose, and measured against recorded frames."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.engine.avatar import RENDERERS
from app.engine.background import Background, Mouth, Planes, Planner
from app.engine.metrics import PictureScores, Window, gradient_energy, picture_scores, psnr, ssim
from app.engine.modes import Modes, draw_crop
from app.engine.pack import Pack
from app.errors import NotFound

Float = NDArray[np.float32]
Array = NDArray[np.float64]

SUDDEN = 99.0
"""Percentile of the change from picture to picture that jumps are told by."""


@dataclass(frozen=True)
class Drawer:
    """A renderer that draws crops.

    Attributes:
        name: of the renderer.
        mouth: made for `still` alone.
        still: the pack's background without its loop.
        modes: of the pack.
        rest: (K,) its mouth at rest.
    """

    name: str
    mouth: Mouth
    still: Background
    modes: Modes
    rest: Float

    @classmethod
    def of(cls, pack: Pack, name: str) -> Drawer:
        """The renderer of this name for a pack.

        Raises:
            NotFound: there is no such renderer.
            BadPack: the pack lacks what it needs.
        """
        if name not in RENDERERS:
            raise NotFound(
                f"there is no renderer {name!r}", field="renderers", advice=f"Known: {', '.join(RENDERERS)}."
            )
        still = replace(pack.background, pictures=pack.background.pictures[-1:], pose=pack.background.pose[-1:])
        mouth = RENDERERS[name](replace(pack, background=still))
        return cls(name, mouth, still, pack.modes, pack.trajectory.rest)

    @property
    def plans(self) -> bool:
        """Whether it chooses what it shows for a whole trajectory."""
        return isinstance(self.mouth, Planner)

    def luma(self, rows: Float, offset: Float) -> Float:
        """(T, h, w) pictures of a trajectory in the crop.

        What a passage has of its own at rest is part of the mouth where the renderer draws any coefficients. One that
        plans knows only what it can show: there the difference that the offset makes to the mouth at rest is added to
        the pictures.

        Args:
            rows: (T, K) without the passage's offset.
            offset: (K,) how the passage's mouth at rest differs from the common one.
        """
        if not isinstance(self.mouth, Planner):
            return self._drawn((rows + offset).astype(np.float32))
        drawn = self._drawn(self.mouth.plan(rows.astype(np.float32), None))
        moved, common = (draw_crop(self.modes, each).luma for each in (self.rest + offset, self.rest))
        return np.asarray(drawn + (moved - common), np.float32)

    def _drawn(self, rows: Float) -> Float:
        region, crop = self.still.region, self.still.crop
        down = slice(crop.y - region.y, crop.y - region.y + crop.height)
        across = slice(crop.x - region.x, crop.x - region.x + crop.width)
        drawn = np.empty((len(rows), crop.height, crop.width), np.float32)
        planes = Planes.empty(region.width, region.height)
        for picture, row in zip(drawn, rows, strict=True):
            self.mouth.draw(row, self.still.frames, planes)
            picture[:] = planes.luma[down, across]
        return np.clip(drawn, 0, 255, out=drawn)


@dataclass(frozen=True, slots=True)
class RenderedScores:
    """A model's trajectories, drawn.

    Attributes:
        renderer: its name.
        pictures: in speech, luma of the mouth box; None if there is no speech.
        sharpness: gradient energy of the mouth box in speech over that of the recorded pictures.
        jumps: 99th percentile of the change from picture to picture (root mean square of the mouth box) over that of
            the recorded pictures.
        squares: eq. 17 of Wang 2010: mean over frames of the squared distance in the common space, which is not divided
            by its deviations for it.
        milliseconds: to choose and draw a picture, on one core, the median over sentences.
    """

    renderer: str
    pictures: PictureScores | None
    sharpness: float
    jumps: float
    squares: float
    milliseconds: float


class Gallery:
    """Collects what `RenderedScores` are made of, sentence by sentence.

    Args:
        renderer: its name.
        window: the mouth box.
    """

    def __init__(self, renderer: str, window: Window) -> None:
        self._renderer, self._window = renderer, window
        self._ratios: list[Array] = []
        self._similarities: list[Array] = []
        self._energies: list[tuple[float, float, int]] = []
        self._changes: list[tuple[Array, Array]] = []
        self._squares: list[Array] = []
        self._spent: list[float] = []

    def add(
        self, shown: Float, recorded: NDArray[np.uint8], speech: NDArray[np.bool_], squares: Array, spent: float
    ) -> None:
        """A sentence's counted frames.

        Args:
            shown, recorded: (n, h, w) luma.
            speech: (n,) which show speech.
            squares: (n,) squared distances in the common space.
            spent: seconds.
        """
        if speech.any():
            self._ratios.append(psnr(shown[speech], recorded[speech], self._window))
            self._similarities.append(ssim(shown[speech], recorded[speech], self._window))
            energies = (gradient_energy(each[speech], self._window) for each in (shown, recorded))
            self._energies.append((*energies, int(speech.sum())))  # type: ignore[arg-type]
        if len(shown) > 1:
            self._changes.append((changes(shown, self._window), changes(recorded, self._window)))
        self._squares.append(squares)
        self._spent.append(spent * 1000 / max(len(shown), 1))

    def scores(self) -> RenderedScores:
        """Of all that was added."""
        ratios, similarities = (
            np.concatenate(each) if each else np.zeros(0) for each in (self._ratios, self._similarities)
        )
        energy = [sum(pair[side] * count for *pair, count in self._energies) for side in (0, 1)]
        sudden = [
            float(np.percentile(np.concatenate([pair[side] for pair in self._changes]), SUDDEN))
            if self._changes
            else float("nan")
            for side in (0, 1)
        ]
        return RenderedScores(
            self._renderer, picture_scores(ratios, similarities), _share(energy), _share(sudden),
            float(np.concatenate(self._squares).mean()), float(np.median(self._spent)),
        )  # fmt: skip


def changes(pictures: NDArray[np.uint8] | Float, window: Window) -> Array:
    """(n - 1,) root mean square change from each picture (n, h, w) to the next in a window."""
    inner = pictures[:, window[0], window[1]].astype(np.float64)
    return np.asarray(np.sqrt(np.square(np.diff(inner, axis=0)).reshape(len(inner) - 1, -1).mean(1)))


def draw_sentence(drawer: Drawer, rows: Float, offset: Float) -> tuple[Float, float]:
    """Pictures (T, h, w) of a trajectory, and the seconds that it took."""
    begin = time.perf_counter()
    return drawer.luma(rows, offset), time.perf_counter() - begin


def _share(pair: Sequence[float]) -> float:
    return float(pair[0] / pair[1]) if pair[1] > 0 else float("nan")
