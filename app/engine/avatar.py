"""An avatar ready to speak: a loaded pack with its trajectory model and its renderer."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from app.engine.background import Compositor, Mouth
from app.engine.frame import Picture, empty
from app.engine.mmm import MorphMouth
from app.engine.modes import ModeMouth
from app.engine.pack import MANIFEST, Manifest, Pack, check_files, load_pack
from app.engine.threads import one_thread_a_call
from app.engine.trajectory import Coefficients
from app.errors import BadPack, NotFound
from app.speech import SILENCE, Phone

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
    avatar = Avatar(load_pack(folder), renderer)
    _warm_up(avatar)
    return avatar


def _warm_up(avatar: Avatar) -> None:
    """Have everything compiled that a first request would have to wait for."""
    manifest = avatar.manifest
    spoken = avatar.trajectory((Phone("AA", 0.0, 0.2),), 4)
    continued = avatar.trajectory((Phone(SILENCE, 0.0, 0.2),), 4, before=spoken)
    avatar.render(continued[0], 0, empty(manifest.width, manifest.height))


class AvatarShelf:
    """The avatars of a folder, each loaded when it is first asked for and then kept.

    What was found wrong with a pack is remembered until one of its files changes.
    """

    def __init__(self, folder: Path, renderer: str = "fast", default: str = "mary") -> None:
        self._folder, self._renderer, self.default = folder, renderer, default
        self._checked: dict[str, tuple[_Stamp, Manifest | BadPack]] = {}
        self._loaded: dict[str, Avatar] = {}
        self._lock = threading.Lock()

    def ids(self) -> tuple[str, ...]:
        """Names of the packs in the folder, the default first; hidden folders are drafts of packs in training."""
        found = (path.parent.name for path in self._folder.glob(f"*/{MANIFEST}"))
        packs = [name for name in found if not name.startswith(".")]
        return tuple(sorted(packs, key=lambda name: (name != self.default, name)))

    def usable(self) -> tuple[Manifest, ...]:
        """The packs of the folder whose files are whole, the default first."""
        verdicts = (self._verdict(avatar) for avatar in self.ids())
        return tuple(verdict for verdict in verdicts if isinstance(verdict, Manifest))

    def manifest(self, avatar: str) -> Manifest:
        """The manifest of one pack, its files checked, nothing loaded.

        Raises:
            NotFound: there is no such pack.
            BadPack: it is damaged.
        """
        if not self._folder.is_dir():
            raise NotFound("there are no avatars: their folder does not exist", advice="Check avatars.folder.")
        if avatar not in self.ids():
            known = ", ".join(self.ids()) or "none"
            raise NotFound(f"there is no avatar {avatar!r}", field="avatar", advice=f"Known avatars: {known}.")
        verdict = self._verdict(avatar)
        if isinstance(verdict, BadPack):
            raise BadPack(verdict.message, advice=verdict.advice, field="avatar")
        return verdict

    def folder(self, avatar: str) -> Path:
        """Where one pack lies; raises as `manifest` does."""
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
                stamp = _stamp(self._folder / avatar)
                try:
                    self._loaded[avatar] = load_avatar(self._folder / avatar, self._renderer)
                except BadPack as error:
                    self._checked[avatar] = (stamp, error)
                    raise
            return self._loaded[avatar]

    def _verdict(self, avatar: str) -> Manifest | BadPack:
        folder = self._folder / avatar
        stamp = _stamp(folder)
        known = self._checked.get(avatar)
        if known is not None and known[0] == stamp:
            return known[1]
        verdict: Manifest | BadPack
        try:
            verdict = check_files(folder)
            if verdict.id != avatar:
                verdict = BadPack(f"{folder} calls itself {verdict.id!r}", advice="Name the folder after it.")
        except BadPack as error:
            verdict = error
        self._checked[avatar] = (stamp, verdict)
        return verdict


_Stamp = tuple[tuple[str, int, int], ...]


def _stamp(folder: Path) -> _Stamp:
    """What changes when a file of the pack does: names, times and sizes."""
    found = ((path.name, path.lstat()) for path in sorted(folder.iterdir()))
    return tuple((name, status.st_mtime_ns, status.st_size) for name, status in found)
