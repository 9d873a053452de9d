from __future__ import annotations

import json
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from tiny_pack import write_tiny

from app.engine.avatar import RENDERERS, AvatarShelf, load_avatar
from app.engine.background import STILL
from app.errors import BadPack, NotFound
from app.speech import SILENCE, Phone


@pytest.fixture
def shelf(tmp_path: Path) -> AvatarShelf:
    for name in ("mary", "anna", "zoe"):
        write_tiny(tmp_path / name, name)
    (tmp_path / "notes").mkdir()
    (tmp_path / "readme.txt").write_text("not an avatar")
    return AvatarShelf(tmp_path)


@pytest.mark.parametrize("renderer", list(RENDERERS))
def test_an_avatar_speaks_from_phones_to_pictures(sampled: Path, renderer: str) -> None:
    avatar = load_avatar(sampled, renderer)
    assert avatar.folder == sampled
    assert avatar.manifest.title == "Tiny"
    assert (avatar.folder / "idle.mp4").is_file()
    rows = avatar.trajectory([Phone(SILENCE, 0, 0.3), Phone("AA", 0.3, 0.6)], 15)
    assert rows.shape == (15, 5)
    assert rows.dtype == np.float32
    picture = np.empty((72, 64), np.uint8)
    for frame in (0, 7, STILL):
        avatar.render(None, frame, picture)
        loop = picture.copy()
        avatar.render(avatar.rest, frame, picture)
        np.testing.assert_array_equal(picture, loop)
        avatar.render(rows[np.linalg.norm(rows - avatar.rest, axis=1).argmax()], frame, picture)
        assert (picture != loop).any()


def test_an_unknown_renderer_is_named_with_those_there_are(tiny: Path) -> None:
    with pytest.raises(NotFound, match="'oil'") as raised:
        load_avatar(tiny, "oil")
    assert raised.value.advice == "Known: fast, reference, selection."


def test_the_shelf_lists_packs_with_the_default_first(shelf: AvatarShelf) -> None:
    assert shelf.ids() == ("mary", "anna", "zoe")
    assert shelf.default == "mary"


def test_an_avatar_is_loaded_once(shelf: AvatarShelf) -> None:
    with ThreadPoolExecutor(4) as threads:
        assert len({id(avatar) for avatar in threads.map(shelf.get, ["anna"] * 8)}) == 1
    assert shelf.get("anna").manifest.id == "anna"
    assert shelf.manifest("zoe").id == "zoe"


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".",
        "..",
        "../mary",
        "mary/",
        "./mary",
        "mary/../anna",
        "/etc",
        "MARY",
        "mary\x00",
        "mary.",
        "nobody",
        "notes",
    ],
)
def test_only_names_on_the_list_are_found(shelf: AvatarShelf, name: str) -> None:
    for ask in (shelf.get, shelf.manifest, shelf.folder):
        with pytest.raises(NotFound) as raised:
            ask(name)
        assert raised.value.field == "avatar"
        assert raised.value.advice == "Known avatars: mary, anna, zoe."


def test_an_absolute_path_to_a_pack_is_no_name(shelf: AvatarShelf, tiny: Path) -> None:
    with pytest.raises(NotFound):
        shelf.get(str(tiny))


def test_without_packs_nobody_is_known(tmp_path: Path) -> None:
    assert AvatarShelf(tmp_path).ids() == ()
    assert AvatarShelf(tmp_path / "missing").ids() == ()
    with pytest.raises(NotFound) as raised:
        AvatarShelf(tmp_path).get("mary")
    assert raised.value.advice == "Known avatars: none."


def test_a_pack_in_a_folder_of_another_name_is_refused(shelf: AvatarShelf, tmp_path: Path) -> None:
    (tmp_path / "zoe").rename(tmp_path / "chloe")
    for ask in (shelf.get, shelf.manifest):
        with pytest.raises(BadPack, match="calls itself 'zoe'"):
            ask("chloe")


def test_a_damaged_pack_does_not_spoil_the_others(shelf: AvatarShelf, tmp_path: Path) -> None:
    (tmp_path / "zoe" / "model.npz").write_bytes(b"")
    (tmp_path / "anna" / "manifest.json").write_text("{")
    for name in ("zoe", "anna"):
        with pytest.raises(BadPack):
            shelf.get(name)
    assert shelf.ids() == ("mary", "anna", "zoe")
    assert shelf.get("mary").manifest.id == "mary"
    with pytest.raises(BadPack):  # and again, not half loaded
        shelf.get("zoe")
    shutil.rmtree(tmp_path / "zoe")
    write_tiny(tmp_path / "zoe", "zoe")
    assert shelf.get("zoe").manifest.id == "zoe"


def test_the_draft_of_a_pack_in_training_is_not_on_the_shelf(shelf: AvatarShelf, tmp_path: Path) -> None:
    shutil.copytree(tmp_path / "mary", tmp_path / ".mary-x1y2")
    assert shelf.ids() == ("mary", "anna", "zoe")


def test_the_shipped_avatar_says_what_it_is() -> None:
    shipped = AvatarShelf(Path(__file__).resolve().parents[2] / "avatars")
    manifest = shipped.manifest("mary")
    assert (manifest.fps, manifest.width, manifest.height, manifest.loop_frames) == (25, 512, 512, 125)
    assert json.loads((shipped.folder("mary") / "manifest.json").read_text())["consent"]["subject"].startswith("nobody")


def test_loading_compiles_all_that_a_first_request_needs() -> None:
    code = (
        "from pathlib import Path\n"
        "from app.engine.avatar import load_avatar\n"
        "from app.engine import banded, warp\n"
        "load_avatar(Path('avatars/mary'))\n"
        "for loop in (banded.solve, warp.invert_mesh, warp.halve_map, warp.blend):\n"
        "    assert loop.signatures, loop\n"
        "from app.engine.avatar import load_avatar\n"
        "before = [len(loop.signatures) for loop in (banded.solve, warp.invert_mesh, warp.halve_map, warp.blend)]\n"
        "import numpy as np\n"
        "from app.speech import Phone\n"
        "avatar = load_avatar(Path('avatars/mary'))\n"
        "row = avatar.trajectory((Phone('M', 0, 0.1), Phone('AA', 0.1, 0.4)), 10)\n"
        "avatar.render(row[3], 77, np.empty((768, 512), np.uint8))\n"
        "after = [len(loop.signatures) for loop in (banded.solve, warp.invert_mesh, warp.halve_map, warp.blend)]\n"
        "assert after == before\n"
    )
    subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).resolve().parents[2], check=True)


def test_a_damaged_pack_is_not_offered_until_it_is_mended(tmp_path: Path) -> None:
    for name in ("anna", "zoe"):
        write_tiny(tmp_path / name, name)
    shelf = AvatarShelf(tmp_path, default="anna")
    assert [manifest.id for manifest in shelf.usable()] == ["anna", "zoe"]
    whole = (tmp_path / "zoe" / "model.npz").read_bytes()
    (tmp_path / "zoe" / "model.npz").write_bytes(whole[:-1])
    assert [manifest.id for manifest in shelf.usable()] == ["anna"]
    for _ in range(2):
        with pytest.raises(BadPack, match="damaged"):
            shelf.get("zoe")
    assert shelf.get("anna").manifest.id == "anna"
    (tmp_path / "zoe" / "model.npz").write_bytes(whole)
    assert [manifest.id for manifest in shelf.usable()] == ["anna", "zoe"]
    assert shelf.get("zoe").manifest.id == "zoe"
