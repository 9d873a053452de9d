"""Where training keeps finished steps, so that an interrupted one goes on where it was.

A hidden folder beside the avatar to be. Every step's result lies in a file named after the step and a key of everything
it depends on; it is written beside its place and then moved there, so a file that is there is whole.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.engine.training.frame_store import FrameStore
from app.errors import TrainingStopped

VERSION = 1
"""Of what the steps compute: raise it, and nothing of older runs is used any more."""

KEY_LENGTH = 16

Arrays = dict[str, NDArray[Any]]


class Workspace:
    """Finished steps in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def step(self, name: str, key: str, compute: Callable[[], Mapping[str, NDArray[Any]]]) -> Arrays:
        """The arrays of a step: those of an earlier run, or computed now and kept.

        Args:
            name: of the step; its older results with other keys are removed.
            key: see `key`.
            compute: makes the arrays; nothing pickled.
        """
        path = self.folder / f"{name}-{key}.npz"
        found = self._load(path)
        if found is not None:
            return found
        arrays = dict(compute())
        self._keep(path, arrays)
        return arrays

    def kept(self, name: str, key: str) -> Arrays | None:
        """The arrays of a step if an earlier run finished it."""
        return self._load(self.folder / f"{name}-{key}.npz")

    def keep(self, name: str, key: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep the arrays of a step."""
        self._keep(self.folder / f"{name}-{key}.npz", dict(arrays))

    def store(
        self, name: str, key: str, rows: int, shape: tuple[int, ...], dtype: Any, fill: Callable[[FrameStore], None]
    ) -> FrameStore:
        """A store of frames: that of an earlier run if it was filled, or filled now."""
        path = self.folder / f"{name}-{key}.rows"
        store = FrameStore(path, rows, shape, np.dtype(dtype))
        mark = path.with_suffix(".done")
        if mark.exists() and path.exists() and path.stat().st_size == rows * store.bytes_a_row:
            return store
        self._make_room()
        for ending in (".done", ".rows"):
            self._remove_older(name, ending)
        with _writing(path):
            store = FrameStore.create(path, rows, shape, dtype)
            fill(store)
            mark.touch()
        return store

    def remove(self) -> None:
        """Remove everything kept."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _make_room(self) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise TrainingStopped(f"{self.folder} cannot be made: {error.strerror or error}") from error

    def _keep(self, path: Path, arrays: Arrays) -> None:
        self._make_room()
        name = path.stem.rpartition("-")[0]
        draft = path.with_suffix(".part")
        with _writing(draft):
            with draft.open("wb") as file:
                np.savez(file, allow_pickle=False, **arrays)
            self._remove_older(name, ".npz")
            draft.replace(path)

    def _remove_older(self, name: str, ending: str) -> None:
        for old in self.folder.glob(f"{name}-{'?' * KEY_LENGTH}{ending}"):
            old.unlink()

    def _load(self, path: Path) -> Arrays | None:
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                return {name: stored[name] for name in stored.files}
        except Exception:  # not there, or damaged, which shows in many ways
            return None


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Says where, when the disk is full or read-only, and leaves nothing half-written there."""
    try:
        yield
    except BaseException as error:
        with suppress(OSError):
            path.unlink()
        if isinstance(error, OSError):
            raise TrainingStopped(
                f"{path.parent} cannot be written: {error.strerror or error}",
                advice="Make room on the disk, or name another output; the finished steps are kept.",
            ) from error
        raise


def key(*parts: Any) -> str:
    """A short key of everything a step depends on; arrays count by their bytes."""
    digest = hashlib.sha256(f"{VERSION}".encode())
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype}{part.shape}".encode())
            digest.update(np.ascontiguousarray(part).tobytes())
        else:
            digest.update(json.dumps(part, default=_plain, sort_keys=True).encode())
        digest.update(b"\0")
    return digest.hexdigest()[:KEY_LENGTH]


def _plain(part: object) -> Any:
    """What JSON has no notation for; an array's own text would leave out its middle."""
    if isinstance(part, np.ndarray):
        return key(part)
    if isinstance(part, np.generic):
        return part.item()
    if isinstance(part, Path):
        return str(part)
    raise TypeError(f"a key cannot be made of {type(part).__name__}")
