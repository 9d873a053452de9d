"""An avatar ready to speak: a loaded pack with one of its trajectory models and one of the renderers."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from app.engine.background import Compositor, Mouth, Planner
from app.engine.frame import Picture, empty
from app.engine.mmm import MorphMouth
from app.engine.models.pack_models import PackModels
from app.engine.models.registry import DEFAULT, check_kinds
from app.engine.models.sound import Sound
from app.engine.modes import ModeMouth
from app.engine.pack import MANIFEST, MODELS, Manifest, Pack, check_files, load_pack
from app.engine.selection import load_selection
from app.engine.threads import one_thread_a_call
from app.engine.trajectory import Coefficients
from app.errors import BadPack, NotFound
from app.speech import SILENCE, Phone

RENDERERS: dict[str, Callable[[Pack], Mouth]] = {
    "fast": lambda pack: ModeMouth(pack.modes, pack.background),
    "reference": lambda pack: MorphMouth(pack.morphable, pack.modes, pack.background),
    "selection": load_selection,
}
OF_EVERY_PACK = frozenset(["fast", "reference"])
"""Renderers that draw from the model itself; the others need a file of their own name in the pack."""
USUAL = "fast"
"""The renderer unless the settings, the pack or the caller name another."""


def renderers(manifest: Manifest) -> tuple[str, ...]:
    """Names of the renderers that can draw a pack."""
    return tuple(name for name in RENDERERS if name in OF_EVERY_PACK or name in manifest.extras)


class Avatar:
    """One avatar. All methods may be called from several threads at once.

    Args:
        pack: whose.
        renderer: of `RENDERERS`.
        trajectory: name of the model it speaks with; if the pack has none of it, its Gaussians speak instead.

    Attributes:
        pack: as given.
        renderer: name of what draws.
        model: what moves the mouth.
        excuse: why `model` is not the one that was wanted; empty if it is.
        rest: (K,) the mouth at rest.
    """

    def __init__(self, pack: Pack, renderer: str = USUAL, trajectory: str = DEFAULT) -> None:
        self._share(pack, renderer, PackModels(pack), _drawn_by(pack, renderer), trajectory)

    def _share(
        self, pack: Pack, renderer: str, models: PackModels, drawing: tuple[Mouth, Compositor], trajectory: str
    ) -> None:
        self.pack, self.renderer = pack, renderer
        self.rest: Coefficients = pack.trajectory.rest
        self._models = models
        self._mouth, self._compositor = drawing
        chosen = models.preferred(trajectory)
        self.model, self.excuse = chosen.model, chosen.excuse

    @property
    def manifest(self) -> Manifest:
        """What the pack says of itself."""
        return self.pack.manifest

    @property
    def folder(self) -> Path:
        """Where the pack lies, with its `idle.mp4` and `preview.jpg`."""
        return self.pack.folder

    @property
    def trajectories(self) -> tuple[str, ...]:
        """Names of the models that it can speak with."""
        return self._models.names()

    def speaking_by(self, trajectory: str) -> Avatar:
        """The same avatar, its mouth moved by another model; costs nothing.

        Raises:
            NotFound: the pack has none of this name; the advice says what it has.
            BadPack, MissingExtra: it cannot be used.
        """
        self._models.get(trajectory)
        other = object.__new__(Avatar)
        other._share(self.pack, self.renderer, self._models, (self._mouth, self._compositor), trajectory)
        return other

    def drawn_by(self, renderer: str) -> Avatar:
        """The same avatar with another renderer; takes a second and memory for its masks.

        Raises:
            NotFound: there is no such renderer.
            BadPack: the pack lacks what it needs.
        """
        other = object.__new__(Avatar)
        other._share(self.pack, renderer, self._models, _drawn_by(self.pack, renderer), self.model.name)
        other.excuse = self.excuse
        return other

    def trajectory(
        self,
        phones: Sequence[Phone],
        frames: int,
        *,
        before: Coefficients | None = None,
        sound: Sound | None = None,
        recognised: bool = False,
    ) -> Coefficients:
        """(frames, K) mouth coefficients; see `app.engine.models.model.TrajectoryModel.predict`.

        Args:
            phones, frames, before, sound: see there.
            recognised: the phones were heard in the sound: a model that can speak from the sound itself does.
        """
        if sound is not None and "sound" in self.model.inputs and (recognised or "phones" not in self.model.inputs):
            phones = ()
        rows = self.model.predict(phones, frames, before=before, sound=sound)
        return self._mouth.plan(rows, before) if isinstance(self._mouth, Planner) else rows

    def render(self, coefficients: Coefficients | None, loop_frame: int, out: Picture) -> None:
        """Write one whole picture.

        Args:
            coefficients: (K,) of the mouth; None for the background alone.
            loop_frame: which frame of the loop is behind it, counted on for ever; `background.STILL` for the
                recording's rest pose.
            out: (height * 3 // 2, width) uint8, overwritten.
        """
        self._compositor.render(coefficients, loop_frame, out)


def _drawn_by(pack: Pack, renderer: str) -> tuple[Mouth, Compositor]:
    if renderer not in RENDERERS:
        raise NotFound(f"there is no renderer {renderer!r}", field="renderer", advice=f"Known: {', '.join(RENDERERS)}.")
    mouth = RENDERERS[renderer](pack)
    return mouth, Compositor(pack.background, mouth, pack.trajectory.rest)


def load_avatar(folder: Path, renderer: str = "", trajectory: str = "") -> Avatar:
    """Load a pack and make it ready.

    Args:
        folder: of the pack.
        renderer, trajectory: empty: what the pack itself prefers, else the usual ones.

    Raises:
        BadPack: the pack is damaged.
        NotFound: no such renderer.
    """
    one_thread_a_call()
    pack = load_pack(folder)
    avatar = Avatar(
        pack, renderer or pack.manifest.renderer or USUAL, trajectory or pack.manifest.trajectory or DEFAULT
    )
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

    Raises:
        NotFound: there is no such trajectory model at all.
    """

    def __init__(self, folder: Path, renderer: str = "", default: str = "mary", trajectory: str = "") -> None:
        check_kinds([trajectory] if trajectory else [], field="engine.trajectory")
        self._folder, self._renderer, self._trajectory, self.default = folder, renderer, trajectory, default
        self._checked: dict[str, tuple[_Stamp, Manifest | BadPack]] = {}
        self._loaded: dict[str, Avatar] = {}
        self._drawn: dict[tuple[str, str], Avatar] = {}  # by other renderers than its usual one
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

    def get(self, avatar: str, *, trajectory: str | None = None, renderer: str | None = None) -> Avatar:
        """The avatar, loaded if need be.

        Args:
            avatar: its name.
            trajectory: what moves its mouth; None: what the settings say, else the pack, else its Gaussians.
            renderer: what draws it; None: what the settings say, else the pack, else the usual one.

        Raises:
            NotFound: there is no such pack, or it cannot be spoken or drawn with so; the advice says what there is.
            BadPack: it is damaged.
        """
        self.manifest(avatar)
        with self._lock:
            found = self._usual(avatar)
            if renderer is not None and renderer != found.renderer:
                if (avatar, renderer) not in self._drawn:
                    self._drawn[avatar, renderer] = found.drawn_by(renderer)
                found = self._drawn[avatar, renderer]
        if trajectory is None or (trajectory == found.model.name and not found.excuse):
            return found
        return found.speaking_by(trajectory)

    def _usual(self, avatar: str) -> Avatar:
        if avatar not in self._loaded:
            stamp = _stamp(self._folder / avatar)
            try:
                self._loaded[avatar] = load_avatar(self._folder / avatar, self._renderer, self._trajectory)
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
    found = ((path.name, path.lstat()) for path in (*sorted(folder.iterdir()), *sorted(folder.glob(f"{MODELS}/*"))))
    return tuple((name, status.st_mtime_ns, status.st_size) for name, status in found)
