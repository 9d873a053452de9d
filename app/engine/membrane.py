"""Seamless stitching: a source goes into a region of a target by solving Poisson's equation (Perez 2003).

Inside the region the result has the gradients of the source, on its edge the values of the target. It is the source
plus a membrane: the harmonic function that is target minus source on the edge. The region is the same for all mouths
of an avatar, so its Laplacian is factorised once, and a membrane costs two triangular solves.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from app.engine.modes import split_texture

Float = NDArray[np.float32]

USUAL = 4.0
"""Deviations by which a difference along the edge may be off the others; further, one of both shows something else."""
LEAST_USUAL = 6.0
"""Levels that it may be off in any case."""
REACH = 0.1
"""Standard deviation of the blur that fills in for such differences, in widths of the plane."""


_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


class Membrane:
    """Harmonic functions on a region of a plane.

    Args:
        inside: (h, w) the region; what touches the edge of the plane does not belong to it.
    """

    def __init__(self, inside: NDArray[np.bool_]) -> None:
        self.inside = inside.copy()
        self.inside[[0, -1]] = False
        self.inside[:, [0, -1]] = False
        self.edge = cv2.dilate(self.inside.astype(np.uint8), _CROSS).astype(bool) & ~self.inside
        number = np.full(inside.shape, -1, np.int64)
        self._rows, self._columns = np.nonzero(self.inside)
        count = len(self._rows)
        number[self._rows, self._columns] = np.arange(count)
        of, to = [], []
        self._neighbours = []
        for down, across in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            place = (self._rows + down, self._columns + across)
            self._neighbours.append(place)
            known = number[place] >= 0
            of.append(np.flatnonzero(known))
            to.append(number[place][known])
        row, column = np.concatenate(of), np.concatenate(to)
        values = np.concatenate([np.full(count, 4.0), np.full(len(row), -1.0)])
        diagonal = np.arange(count)
        laplacian = coo_matrix(
            (values, (np.concatenate([diagonal, row]), np.concatenate([diagonal, column]))), (count, count)
        ).tocsc()
        self._solve = splu(laplacian).solve if count else None

    def trusted(self, difference: Float) -> Float:
        """(h, w) a difference whose outliers along the edge are filled in from beside them.

        Where the head has turned, wall may be seen beyond one cheek; its colour must not spread over the mouth.
        """
        along = difference[self.edge]
        if not len(along):
            return difference
        off = np.abs(difference - np.median(along))
        deviation = 1.4826 * float(np.median(off[self.edge]))
        usual = self.edge & (off <= max(LEAST_USUAL, USUAL * deviation))
        if usual.sum() == len(along):
            return difference
        sigma = REACH * difference.shape[1]
        weight = cv2.GaussianBlur(usual.astype(np.float32), (0, 0), sigma)
        near = cv2.GaussianBlur(np.where(usual, difference, 0).astype(np.float32), (0, 0), sigma)
        filled = np.where(weight > 1e-4, near / np.maximum(weight, 1e-4), np.median(along))
        return np.asarray(np.where(self.edge & ~usual, filled, difference), np.float32)

    def stretch(self, edge: Float) -> Float:
        """(h, w) what is harmonic in the region and equals `edge`, (h, w), outside of it."""
        filled = edge.astype(np.float64)
        filled[self.inside] = 0
        if self._solve is not None:
            given = sum((filled[place] for place in self._neighbours), np.zeros(len(self._rows)))
            filled[self._rows, self._columns] = self._solve(given)
        return filled.astype(np.float32)


class Stitcher:
    """Stitches the planes of a crop.

    Args:
        mask: (h, w) of the crop's luma; the region is where it is above zero.
    """

    def __init__(self, mask: Float) -> None:
        half = cv2.resize(mask, (mask.shape[1] // 2, mask.shape[0] // 2), interpolation=cv2.INTER_AREA)
        self._size = (mask.shape[1], mask.shape[0])
        self._luma, self._chroma = Membrane(mask > 0), Membrane(half > 0)
        each = (self._luma, self._chroma, self._chroma)
        self._inside = np.concatenate([part.inside.reshape(-1) for part in each])

    def membrane(self, difference: Float) -> Float:
        """(P,) harmonic in the region, and on its edge as this difference (P,), planes flattened, but for outliers."""
        luma, blue, red = split_texture(difference, *self._size).each()
        parts = ((self._luma, luma), (self._chroma, blue), (self._chroma, red))
        return np.concatenate([part.stretch(part.trusted(plane)).reshape(-1) for part, plane in parts])

    def stitched(self, source: Float, target: Float) -> Float:
        """(P,) the source in the region, seamlessly, and the target outside of it."""
        mixed = source + self.membrane(target - source)
        return np.where(self._inside, mixed, target)
