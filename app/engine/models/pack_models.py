"""The trajectory models of one pack: its Gaussians, and those in files beside them, read when first asked for."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from app.engine.models.model import TrajectoryModel
from app.engine.models.model_file import load_trajectory
from app.engine.models.registry import DEFAULT, KINDS, kind
from app.engine.pack import MODEL, MODELS, Manifest, Pack
from app.errors import BadPack, MaryError, MissingExtra, NotFound


@dataclass(frozen=True)
class Chosen:
    """A model to speak with.

    Attributes:
        model: it.
        excuse: why it is not the one that was preferred; empty if it is.
    """

    model: TrajectoryModel
    excuse: str = ""


def trajectories(manifest: Manifest) -> tuple[str, ...]:
    """Names of the trajectory models that a pack has, its own Gaussians first."""
    known = KINDS.names()
    return (DEFAULT, *(name for name in manifest.extras if name in known and name != DEFAULT))


class PackModels:
    """See the module. Methods may be called from several threads at once."""

    def __init__(self, pack: Pack) -> None:
        self._pack = pack
        self._loaded: dict[str, TrajectoryModel] = {DEFAULT: pack.trajectory}
        self._lock = threading.Lock()

    def names(self) -> tuple[str, ...]:
        """Of the models that the pack has, its own Gaussians first."""
        return trajectories(self._pack.manifest)

    def get(self, name: str) -> TrajectoryModel:
        """The model of this name.

        Raises:
            NotFound: there is no such kind, or the pack has none of it; the advice says what it has.
            BadPack: it is damaged, or of another version.
            MissingExtra: a library that it needs is not installed.
        """
        with self._lock:
            if name not in self._loaded:
                self._loaded[name] = self._read(name)
            return self._loaded[name]

    def preferred(self, name: str) -> Chosen:
        """The model of this name, or the pack's Gaussians with the reason if it cannot be had."""
        try:
            return Chosen(self.get(name))
        except (NotFound, BadPack, MissingExtra) as error:
            return Chosen(self._pack.trajectory, _told(error, name))

    def _read(self, name: str) -> TrajectoryModel:
        if name not in self.names():
            title = self._pack.manifest.id
            problem = (
                f"{title} has no trajectory model {name!r}"
                if name in KINDS.names()
                else f"there is no trajectory model {name!r}"
            )
            raise NotFound(problem, field="trajectory", advice=f"{title} has: {', '.join(self.names())}.")
        folder = self._pack.folder
        return load_trajectory(
            folder / MODELS / f"{name}.npz", kind(name), modes=self._pack.manifest.files[MODEL],
            count=self._pack.modes.count,
        )  # fmt: skip


def _told(error: MaryError, name: str) -> str:
    return f"{error.message}; {DEFAULT} speaks instead of {name}"
