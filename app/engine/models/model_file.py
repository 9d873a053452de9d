"""Trajectory models in files beside a pack's own: written, and read with everything checked."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.engine.models.model import Kind, TrajectoryModel
from app.engine.stored_arrays import StoredArrays, read_arrays
from app.errors import BadPack

KIND, VERSION, MODES = "kind", "kind_version", "modes_digest"
"""Arrays of a file that say what it is."""
PREFIX = "model_"
"""Of the names of a model's own arrays."""


def save_file(path: Path, name: str, version: int, arrays: Mapping[str, NDArray[Any]], *, modes: str) -> None:
    """Write what belongs to one pack.

    Args:
        path: of the file; its folder is made.
        name, version: of its kind.
        arrays: to be read again.
        modes: SHA-256 of the pack's `model.npz`: a model means nothing in another mode space.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    own = {PREFIX + key: array for key, array in arrays.items()}
    head: dict[str, Any] = {KIND: np.array([name]), VERSION: np.array([version]), MODES: np.array([modes])}
    np.savez_compressed(path, allow_pickle=False, **head, **own)


def read_file(path: Path, name: str, version: int, *, modes: str, advice: str) -> StoredArrays:
    """The arrays of a file that `save_file` wrote.

    Args:
        path: of the file.
        name, version: of the kind that it must be.
        modes: SHA-256 of the pack's `model.npz`.
        advice: what to do about a file that is another.

    Raises:
        BadPack: it is damaged, of another kind, version or mode space.
    """
    stored = read_arrays(path)
    try:
        names, digests = stored.names(KIND), stored.names(MODES)
        found = int(stored.numbers(VERSION, (1,))[0])
    except KeyError as error:
        raise BadPack(f"{path} lacks {error}", advice=advice) from error
    if names != (name,):
        raise BadPack(f"{path} holds a model of the kind {', '.join(names)}, not {name}")
    if found != version:
        raise BadPack(f"{path} is {name} of version {found}, this program reads version {version}", advice=advice)
    if digests != (modes,):
        raise BadPack(f"{path} was trained for other mouths than this pack's", advice=advice)
    own = {key.removeprefix(PREFIX): array for key, array in stored.arrays.items() if key.startswith(PREFIX)}
    return StoredArrays(str(path), own)


def save_trajectory(path: Path, kind: Kind, arrays: Mapping[str, NDArray[Any]], *, modes: str) -> None:
    """Write a model (`TrajectoryModel.to_arrays`); see `save_file`."""
    save_file(path, kind.name, kind.version, arrays, modes=modes)


def load_trajectory(path: Path, kind: Kind, *, modes: str, count: int) -> TrajectoryModel:
    """Read a model.

    Args:
        path: of the file.
        kind: that it must be of.
        modes: SHA-256 of the pack's `model.npz`.
        count: K, of the pack's modes.

    Raises:
        BadPack: it is damaged, of another kind, version, mode space or size.
    """
    again = f"Train it again: mary train … --models {kind.name}"
    own = read_file(path, kind.name, kind.version, modes=modes, advice=again)
    try:
        model = kind.load(own)
    except KeyError as error:
        raise BadPack(f"{path} lacks {error}", advice=again) from error
    if len(model.rest) != count:
        raise BadPack(f"{path} has {len(model.rest)} coefficients, the pack's mouths {count}", advice=again)
    return model
