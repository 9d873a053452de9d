"""Arrays in files that may come from anywhere: nothing of them is used before it is checked."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import BadPack

MOST_BYTES = 256 * 2**20
"""A file that unpacks to more is refused unread."""


@dataclass(frozen=True)
class StoredArrays:
    """Arrays by name.

    Attributes:
        where: what messages call the file.
        arrays: as they were read.
    """

    where: str
    arrays: Mapping[str, NDArray[Any]]

    def numbers(self, name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """An array as float32, with the shape it must have (-1: any) and nothing but finite numbers.

        Raises:
            KeyError: there is none of this name.
            BadPack: it is something else.
        """
        return np.ascontiguousarray(self._finite(name, shape, np.float32))

    def exact(self, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """The same as float64."""
        return np.ascontiguousarray(self._finite(name, shape, np.float64))

    def names(self, name: str) -> tuple[str, ...]:
        """A row of strings; raises as `numbers` does."""
        array = self.arrays[name]
        if array.ndim != 1 or array.dtype.kind != "U":
            raise BadPack(f"{self.where}: {name} holds {array.dtype} of shape {array.shape}, expected a row of names")
        return tuple(str(each) for each in array)

    def _finite(self, name: str, shape: tuple[int, ...], dtype: type[np.floating[Any]]) -> NDArray[Any]:
        array = self.arrays[name]
        wrong = any(want not in (-1, have) for want, have in zip(shape, array.shape, strict=False))
        if array.ndim != len(shape) or wrong:
            raise BadPack(f"{self.where}: {name} has shape {array.shape}, expected {shape} (-1: any)")
        if array.dtype.kind not in "fiu":
            raise BadPack(f"{self.where}: {name} holds {array.dtype}, expected numbers")
        with np.errstate(over="ignore"):
            numbers = array.astype(dtype)
        if not np.isfinite(numbers).all():
            raise BadPack(f"{self.where}: {name} holds numbers that are not finite")
        return numbers


def read_arrays(path: Path) -> StoredArrays:
    """Read an `.npz` file; nothing pickled.

    Raises:
        BadPack: it is none, or too large.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > MOST_BYTES:
            raise BadPack(f"{path} unpacks to {size} bytes, more than {MOST_BYTES}")
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except (OSError, ValueError, EOFError, MemoryError, RuntimeError, zlib.error, zipfile.BadZipFile) as error:
        raise BadPack(f"{path} is no model: {error}") from error
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):  # numpy hands out entries that are no arrays as they are
            raise BadPack(f"{path} is no model: {name} is no array")
    return StoredArrays(path.name, arrays)
