"""An avatar ready to speak: a loaded pack with its trajectory model and its renderer."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from app.engine.background import Compositor, Mouth
from app.engine.frame import Picture
from app.engine.mmm import MorphMouth
from app.engine.modes import ModeMouth
from app.engine.pack import Manifest, Pack, load_manifest, load_pack
from app.engine.threads import one_thread_a_call
from app.engine.trajectory import Coefficients
from app.errors import BadPack, NotFound
from app.speech import Phone

RENDERERS: dict[str, Callable[[Pack], Mouth]] = {
    "fast": lambda pack: ModeMouth(pack.modes, pack.background),
    "reference": lambda pack: MorphMouth(pack.morphable, pack.modes, pack.background),
}


class Avatar:
    """One avatar. All methods may be called from several threads at once."""

    def __init__(self, pack: Pack, renderer: str = "fast") -> None:
        if renderer not in RENDERERS:
            raise NotFound(f"there is no renderer {renderer!r}", advice=f"Known: {', '.join(RENDERERS)}.")
        self.pack = pack
        self.rest: Coefficients = pack.trajectory.rest
        self._compositor = Compositor(pack.background, RENDERERS[renderer](pack), self.rest)

    @property
    def manifest(self) -> Manifest:
        """What the pack says of itself."""
        return self.pack.manifest

    @property
    def folder(self) -> Path:
        """Where the pack lies, with its `idle.mp4` and `preview.jpg`."""
        return self.pack.folder

    def trajectory(self, phones: Sequence[Phone], frames: int, *, before: Coefficients | None = None) -> Coefficients:
        """(frames, K) mouth coefficients; see `GaussianTrajectory.predict`."""
        return self.pack.trajectory.predict(phones, frames, before=before)

    def render(self, coefficients: Coefficients | None, loop_frame: int, out: Picture) -> None:
        """Write one whole picture.

        Args:
            coefficients: (K,) of the mouth; None for the background alone.
            loop_frame: which frame of the loop is behind it, counted on for ever; `background.STILL` for the
                recording's rest pose.
            out: (height * 3 // 2, width) uint8, overwritten.
        """
        self._compositor.render(coefficients, loop_frame, out)


def load_avatar(folder: Path, renderer: str = "fast") -> Avatar:
    """Load a pack and make it ready.

    Raises:
        BadPack: the pack is damaged.
        NotFound: no such renderer.
    """
    one_thread_a_call()
    return Avatar(load_pack(folder), renderer)


class AvatarShelf:
    """The avatars of a folder, each loaded when it is first asked for and then kept."""

    def __init__(self, folder: Path, renderer: str = "fast", default: str = "mary") -> None:
        self._folder, self._renderer, self.default = folder, renderer, default
        self._loaded: dict[str, Avatar] = {}
        self._lock = threading.Lock()

    def ids(self) -> tuple[str, ...]:
        """Names of the packs in the folder, the default first; hidden folders are drafts of packs in training."""
        found = (path.parent.name for path in self._folder.glob("*/manifest.json"))
        packs = [name for name in found if not name.startswith(".")]
        return tuple(sorted(packs, key=lambda name: (name != self.default, name)))

    def manifest(self, avatar: str) -> Manifest:
        """The manifest of one pack, without loading the rest.

        Raises:
            NotFound: there is no such pack.
            BadPack: its manifest is damaged.
        """
        if avatar not in self.ids():
            known = ", ".join(self.ids()) or "none"
            raise NotFound(f"there is no avatar {avatar!r}", field="avatar", advice=f"Known avatars: {known}.")
        manifest = load_manifest(self._folder / avatar)
        if manifest.id != avatar:
            raise BadPack(f"{self._folder / avatar} calls itself {manifest.id!r}", advice="Name the folder after it.")
        return manifest

    def folder(self, avatar: str) -> Path:
        """Where one pack lies."""
        self.manifest(avatar)
        return self._folder / avatar

    def get(self, avatar: str) -> Avatar:
        """The avatar, loaded if need be.

        Raises:
            NotFound: there is no such pack.
            BadPack: it is damaged.
        """
        self.manifest(avatar)
        with self._lock:
            if avatar not in self._loaded:
                self._loaded[avatar] = load_avatar(self._folder / avatar, self._renderer)
            return self._loaded[avatar]
