"""Trajectory-guided sample selection (Wang 2010, 3.4 and 2.4): real mouths of the recording, stitched into the loop.

A trajectory only says which mouths to look for; what is shown are the recording's own pixels, so that teeth and tongue
are as sharp as they were recorded. Samples come stitched: seamlessly inside the picture at rest (`Membrane`), the skin
along the seam moved to where it is at rest. What the loop's picture differs by from that along the seam is a second
membrane, one for each picture of the loop. A membrane stays one when it is moved, turned and scaled with the head, and
two add up to one; so a frame is one resampling of a sample, and nothing has to be solved while serving.

The mouth at rest is a sample too: the loop's own.
"""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.engine.background import Background, Planes, chroma_map
from app.engine.membrane import Stitcher
from app.engine.modes import split_texture
from app.engine.pack import MODEL, MODELS, Pack
from app.engine.selection_library import NAME, SampleLibrary, load_library
from app.engine.selection_search import Search, joining_costs, similarities
from app.engine.warp import halve_map, pixel_grid, sample
from app.errors import NotFound

Float = NDArray[np.float32]

REST = 0
"""Number of the mouth at rest; the library's samples follow."""
WEIGHT = 3.0
"""Of joining against following (eq. 11), chosen on held-out sentences of a GRID talker: as far as jumps get fewer and
the trajectory is not lost."""


def load_selection(pack: Pack) -> SelectionMouth:
    """The selection renderer of a pack.

    Raises:
        NotFound: the pack has no samples.
        BadPack: they are damaged, of another version, or of other modes.
    """
    manifest = pack.manifest
    if NAME not in manifest.extras:
        raise NotFound(
            f"{manifest.id} has no samples to select from", field="renderer",
            advice="Train it again: mary train … --models selection",
        )  # fmt: skip
    path = Path(pack.folder) / MODELS / f"{NAME}.npz"
    size = (pack.modes.width, pack.modes.height)
    library = load_library(path, modes=manifest.files[MODEL], count=pack.modes.count, size=size)
    return SelectionMouth(library, pack.background, pack.trajectory.rest)


class SelectionMouth:
    """Draws samples. Safe to use from several threads.

    Args:
        library: the samples.
        background: the loop.
        rest: (K,) the mouth at rest.
        weight: of joining costs against target costs.
    """

    def __init__(self, library: SampleLibrary, background: Background, rest: Float, *, weight: float = WEIGHT) -> None:
        self._background = background
        self._library = library
        self._rows = np.concatenate([np.asarray(rest, np.float32)[None], library.rows])
        self._numbers = {row.tobytes(): number for number, row in reversed(list(enumerate(self._rows)))}
        self._places = self._rows @ library.lips
        still = still_crop(background)
        self._membranes = _loop_membranes(background, still)
        self._search = Search(_joins(library, still), weight)
        self._local = threading.local()

    def plan(self, rows: Float, before: Float | None) -> Float:
        """See `app.engine.background.Planner`: the coefficients of the samples that follow the trajectory."""
        start = self.number(before[-1]) if before is not None and len(before) else None
        chosen: Float = self._rows[self._search.path(self._distances(rows), start)]
        return chosen

    def number(self, coefficients: Float) -> int:
        """The sample of these coefficients (K,); of others, the nearest."""
        found = self._numbers.get(np.ascontiguousarray(coefficients, np.float32).tobytes())
        return int(self._distances(coefficients[None])[0].argmin()) if found is None else found

    def draw(self, coefficients: Float, index: int, out: Planes) -> None:
        """See `app.engine.background.Mouth`."""
        where = self._background.backward(index)
        half = self._half(where)
        maps = (where, half, half)
        number = self.number(coefficients)
        if number == REST:
            picture, region = self._background.pictures[index], self._background.region
            shown = (region.luma(picture), *region.chroma(picture))
            for target, loop, membrane, points in zip(
                out.each(), shown, self._planes(self._membranes[index]), maps, strict=True
            ):
                np.subtract(loop, sample(membrane, points, smooth=False), out=target)
            return
        for target, source, points in zip(
            out.each(), self._planes(self._library.pictures[number - 1]), maps, strict=True
        ):
            sample(source, points, out=target)

    def _planes(self, flat: NDArray[np.generic]) -> tuple[Float, Float, Float]:
        return split_texture(flat.astype(np.float32), self._library.width, self._library.height).each()

    def _distances(self, rows: Float) -> Float:
        """(T, S) target costs (eq. 12): distances of trajectory points (T, K) to the samples, among eigen-lips."""
        wanted = rows @ self._library.lips
        squares = (wanted**2).sum(1)[:, None] + (self._places**2).sum(1) - 2 * wanted @ self._places.T
        return np.asarray(np.sqrt(np.maximum(squares, 0)), np.float32)

    def _half(self, where: Float) -> Float:
        half: Float | None = getattr(self._local, "half", None)
        if half is None:
            half = self._local.half = chroma_map(where)
        else:
            halve_map(where, half)
        return half


def still_crop(background: Background) -> Float:
    """(P,) the crop of the recording's rest pose, planes flattened: what samples are stitched into."""
    still, crop = background.pictures[-1], background.crop
    return np.concatenate([plane.reshape(-1) for plane in (crop.luma(still), *crop.chroma(still))]).astype(np.float32)


def _joins(library: SampleLibrary, still: Float) -> Float:
    """(S, S) joining costs of the mouth at rest, which follows itself, and all samples."""
    top, bottom, left, right = library.window
    size = (-1, library.height, library.width)
    luma = np.concatenate([still[None], library.pictures])[:, : library.width * library.height].reshape(size)
    images = luma[:, top:bottom, left:right].reshape(len(luma), -1).astype(np.float32)
    count = len(luma)
    numbers = np.arange(count)
    follows = np.concatenate([[False], library.follows])
    before = np.where(follows, numbers - 1, numbers)
    after = np.where(np.append(follows[1:], False), numbers + 1, numbers)
    return joining_costs(similarities(images), before, after)


def _loop_membranes(background: Background, still: Float) -> NDArray[np.float16]:
    """(L + 1, P) what every picture of the loop adds to a stitched mouth, in the crop's coordinates."""
    stitcher = Stitcher(background.mask)
    crop, region = background.crop, background.region
    points = pixel_grid(crop.width, crop.height)
    found = np.empty((len(background.pictures), len(still)), np.float16)
    for index, picture in enumerate(background.pictures):
        where = background.forward(index, points)
        half = chroma_map(where)
        seen = [
            sample(plane.astype(np.float32), at).reshape(-1)
            for plane, at in zip((region.luma(picture), *region.chroma(picture)), (where, half, half), strict=True)
        ]
        found[index] = stitcher.membrane(np.concatenate(seen) - still)
    return found
