"""Arrays of one row a frame that stay on disk: a recording of hours is trained in the memory of minutes."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import DTypeLike, NDArray

BLOCK = 256
"""Rows held at once by `blocks`."""


@dataclass(frozen=True)
class FrameStore:
    """Rows of equal shape in a file; they are read when asked for and never mapped into memory.

    Attributes:
        path: the file: nothing but the rows.
        rows: how many.
        shape: of one row.
        dtype: of its numbers.
    """

    path: Path
    rows: int
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @classmethod
    def create(cls, path: Path, rows: int, shape: tuple[int, ...], dtype: DTypeLike) -> FrameStore:
        """A store of so many rows of zeros, in a new file; the disk's room is claimed at once."""
        store = cls(path, rows, shape, np.dtype(dtype))
        with path.open("wb") as file:
            if rows:
                os.posix_fallocate(file.fileno(), 0, rows * store.bytes_a_row)
        return store

    @property
    def bytes_a_row(self) -> int:
        """Of the file."""
        return math.prod(self.shape) * self.dtype.itemsize

    def __len__(self) -> int:
        return self.rows

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Rows from `start` up to `stop`, as far as there are any."""
        start, stop = max(0, start), min(self.rows, stop)
        with self.path.open("rb") as file:
            return self._next(file, start, max(0, stop - start))

    def take(self, numbers: NDArray[np.int64] | list[int]) -> NDArray[Any]:
        """Rows of these numbers, in their order."""
        found = np.empty((len(numbers), *self.shape), self.dtype)
        with self.path.open("rb") as file:
            for place, number in enumerate(numbers):
                if not 0 <= number < self.rows:
                    raise IndexError(f"row {number} of {self.rows}")
                found[place] = self._next(file, int(number), 1)[0]
        return found

    def write(self, start: int, rows: NDArray[Any]) -> None:
        """Put rows in place from `start` on; several processes may write different rows at once."""
        if rows.shape[1:] != self.shape or not 0 <= start <= self.rows - len(rows):
            raise ValueError(f"{rows.shape} from {start} on do not fit into {(self.rows, *self.shape)}")
        with self.path.open("r+b") as file:
            file.seek(start * self.bytes_a_row)
            file.write(np.ascontiguousarray(rows, self.dtype).tobytes())

    def _next(self, file: BinaryIO, start: int, count: int) -> NDArray[Any]:
        file.seek(start * self.bytes_a_row)
        numbers = count * math.prod(self.shape)
        flat = np.fromfile(file, self.dtype, numbers)
        if len(flat) < numbers:
            raise OSError(f"{self.path} was cut off")
        return flat.reshape(count, *self.shape)

    def blocks(self, numbers: NDArray[np.int64], size: int = BLOCK) -> Iterator[NDArray[Any]]:
        """Rows of these (rising) numbers, in blocks."""
        for start in range(0, len(numbers), size):
            wanted = numbers[start : start + size]
            if int(wanted[-1]) - int(wanted[0]) < 2 * size:  # nearly all of a stretch: one read is faster
                yield self.read(int(wanted[0]), int(wanted[-1]) + 1)[wanted - wanted[0]]
            else:
                yield self.take(wanted)
