from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from test_model_file import change

from app.engine.avatar import AvatarShelf, load_avatar
from app.engine.models.model import Spoken
from app.engine.models.model_file import save_trajectory
from app.engine.models.phone_mean import PhoneMeanKind
from app.engine.models.registry import fit
from app.engine.models.sound import Sound
from app.engine.pack import MODEL, MODELS, checksums, digest, load_manifest, load_pack, write_manifest
from app.errors import BadPack, NotFound
from app.speech import SILENCE, Phone

PHONES = (Phone(SILENCE, 0, 0.2), Phone("AA", 0.2, 0.8), Phone("M", 0.8, 1.2), Phone(SILENCE, 1.2, 1.6))


@pytest.fixture
def pack(tiny: Path, tmp_path: Path) -> Path:
    """A tiny pack with a further model."""
    folder = tmp_path / "tiny"
    shutil.copytree(tiny, folder)
    rest = load_pack(folder).trajectory.rest
    rows = np.random.default_rng(0).standard_normal((40, 5)).astype(np.float32)
    model = fit("phone-mean", [Spoken(PHONES, rows, np.ones(40, bool))], rest, fps=25)
    file = folder / MODELS / "phone-mean.npz"
    save_trajectory(file, PhoneMeanKind(), model.to_arrays(), modes=digest(folder / MODEL))
    sealed(folder)
    return folder


def sealed(folder: Path, **said: str) -> None:
    manifest = load_manifest(folder)
    write_manifest(folder, manifest.model_copy(update={"files": checksums(folder), **said}))


def test_a_pack_says_what_it_has(pack: Path, tiny: Path) -> None:
    assert load_avatar(pack).trajectories == ("gaussian", "phone-mean")
    assert load_avatar(tiny).trajectories == ("gaussian",)


def test_an_avatar_speaks_by_another_model(pack: Path) -> None:
    avatar = load_avatar(pack)
    other = avatar.speaking_by("phone-mean")
    assert (avatar.model.name, other.model.name) == ("gaussian", "phone-mean")
    assert not np.allclose(avatar.trajectory(PHONES, 40), other.trajectory(PHONES, 40))
    assert np.array_equal(other.rest, avatar.rest)


def test_a_model_that_the_pack_lacks_is_refused_with_what_it_has(tiny: Path) -> None:
    with pytest.raises(NotFound, match="tiny has no trajectory model 'phone-mean'") as caught:
        load_avatar(tiny).speaking_by("phone-mean")
    assert "gaussian" in caught.value.advice
    with pytest.raises(NotFound, match="there is no trajectory model 'oil'"):
        load_avatar(tiny).speaking_by("oil")


def test_a_preferred_model_that_is_not_there_is_replaced_and_told(tiny: Path) -> None:
    avatar = load_avatar(tiny, trajectory="phone-mean")
    assert avatar.model.name == "gaussian"
    assert avatar.excuse == "tiny has no trajectory model 'phone-mean'; gaussian speaks instead of phone-mean"


def test_so_is_one_of_another_version(pack: Path) -> None:
    change(pack / MODELS / "phone-mean.npz", kind_version=np.array([2]))
    sealed(pack)
    avatar = load_avatar(pack, trajectory="phone-mean")
    assert avatar.model.name == "gaussian"
    assert "of version 2, this program reads version 1" in avatar.excuse
    with pytest.raises(BadPack, match="of version 2"):
        avatar.speaking_by("phone-mean")


def test_a_pack_can_prefer_a_model(pack: Path) -> None:
    sealed(pack, trajectory="phone-mean", renderer="reference")
    avatar = load_avatar(pack)
    assert (avatar.model.name, avatar.renderer, avatar.excuse) == ("phone-mean", "reference", "")
    assert load_avatar(pack, trajectory="gaussian").model.name == "gaussian"


def test_a_damaged_model_damages_the_pack(pack: Path) -> None:
    (pack / MODELS / "phone-mean.npz").write_bytes(b"")
    with pytest.raises(BadPack, match="its checksum differs"):
        load_pack(pack)


def test_a_folder_of_models_that_is_a_link_is_refused(pack: Path, tmp_path: Path) -> None:
    (pack / MODELS).rename(tmp_path / "elsewhere")
    (pack / MODELS).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BadPack, match="no plain file"):
        load_pack(pack)


@pytest.mark.parametrize("name", ["models/../model.npz", "models/A.npz", "models/x/y.npz", "../models/a.npz", "x.npz"])
def test_other_names_are_refused(pack: Path, name: str) -> None:
    manifest = load_manifest(pack)
    write_manifest(pack, manifest.model_copy(update={"files": {**manifest.files, name: "0" * 64}}))
    with pytest.raises(BadPack, match="a pack has"):
        load_pack(pack)


def test_the_shelf_gives_each_request_what_it_asks_for(pack: Path) -> None:
    shelf = AvatarShelf(pack.parent, default="tiny")
    usual = shelf.get("tiny")
    assert shelf.get("tiny") is usual
    other = shelf.get("tiny", trajectory="phone-mean", renderer="reference")
    assert (other.model.name, other.renderer) == ("phone-mean", "reference")
    assert (usual.model.name, usual.renderer) == ("gaussian", "fast")
    again = shelf.get("tiny", trajectory="phone-mean", renderer="reference")
    assert again._compositor is other._compositor  # which is what takes time and memory
    with pytest.raises(NotFound, match="there is no renderer 'oil'"):
        shelf.get("tiny", renderer="oil")


def test_the_shelf_asks_the_settings_before_the_pack(pack: Path) -> None:
    sealed(pack, trajectory="gaussian")
    assert AvatarShelf(pack.parent, trajectory="phone-mean").get("tiny").model.name == "phone-mean"
    with pytest.raises(NotFound, match="'oil'"):
        AvatarShelf(pack.parent, trajectory="oil")


def test_a_model_that_hears_speaks_from_guessed_phones_only_if_it_must(pack: Path) -> None:
    avatar = load_avatar(pack)

    class Hearing:
        name, rest = "hearing", avatar.rest

        def __init__(self, *inputs: str) -> None:
            self.inputs = frozenset(inputs)

        def predict(self, phones: tuple[Phone, ...], frames: int, **_: object) -> np.ndarray:
            return np.full((frames, 5), len(phones), np.float32)

    sound = Sound(np.zeros(16_000, np.float32), 16_000)
    expected = {("phones",): (4, 4), ("phones", "sound"): (4, 0), ("sound",): (0, 0)}
    for inputs, counts in expected.items():
        avatar.model = Hearing(*inputs)  # type: ignore[assignment]
        shown = [avatar.trajectory(PHONES, 2, sound=sound, recognised=recognised)[0, 0] for recognised in (False, True)]
        assert tuple(shown) == counts, inputs
