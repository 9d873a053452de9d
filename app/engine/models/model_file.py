"""Trajectory models in files beside a pack's own: written, and read with everything checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.engine.models.model import Kind, TrajectoryModel
from app.engine.stored_arrays import StoredArrays, read_arrays
from app.errors import BadPack

KIND, VERSION, MODES = "kind", "kind_version", "modes_digest"
"""Arrays of a file that say what it is."""
PREFIX = "model_"
"""Of the names of a model's own arrays."""


def save_trajectory(path: Path, kind: Kind, arrays: dict[str, NDArray[np.generic]], *, modes: str) -> None:
    """Write a model.

    Args:
        path: of the file; its folder is made.
        kind: of the model.
        arrays: `TrajectoryModel.to_arrays`.
        modes: SHA-256 of the pack's `model.npz`: a model means nothing in another mode space.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    own = {PREFIX + name: array for name, array in arrays.items()}
    head = {KIND: np.array([kind.name]), VERSION: np.array([kind.version]), MODES: np.array([modes])}
    np.savez_compressed(path, allow_pickle=False, **head, **own)


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
    stored = read_arrays(path)
    again = f"Train it again: mary train … --models {kind.name}"
    try:
        names, digests = stored.names(KIND), stored.names(MODES)
        version = int(stored.numbers(VERSION, (1,))[0])
        if names != (kind.name,):
            raise BadPack(f"{path} holds a model of the kind {', '.join(names)}, not {kind.name}")
        if version != kind.version:
            raise BadPack(
                f"{path} is {kind.name} of version {version}, this program reads version {kind.version}", advice=again
            )
        if digests != (modes,):
            raise BadPack(f"{path} was trained for other mouths than this pack's", advice=again)
        own = {name.removeprefix(PREFIX): array for name, array in stored.arrays.items() if name.startswith(PREFIX)}
        model = kind.load(StoredArrays(str(path), own))
    except KeyError as error:
        raise BadPack(f"{path} lacks {error}", advice=again) from error
    if len(model.rest) != count:
        raise BadPack(f"{path} has {len(model.rest)} coefficients, the pack's mouths {count}", advice=again)
    return model
