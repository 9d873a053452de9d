from __future__ import annotations

import io
import json
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from tiny_pack import tiny_background, tiny_model, tiny_modes, tiny_trajectory

from app.engine.pack import (
    FILES,
    LOOP,
    MANIFEST,
    MODEL,
    MOST_BYTES,
    PREVIEW,
    checksums,
    load_manifest,
    load_pack,
    save_model,
    write_manifest,
)
from app.engine.training.write_clips import write_loop
from app.errors import BadPack

Arrays = dict[str, NDArray[Any]]

MARY = Path(__file__).resolve().parents[2] / "avatars" / "mary"


@pytest.fixture
def pack(tiny: Path, tmp_path: Path) -> Path:
    """A pack of the test's own, to be damaged."""
    return Path(shutil.copytree(tiny, tmp_path / "tiny"))


def sign(folder: Path) -> None:
    """Make the checksums right again, so that what is inside the files is looked at."""
    edit_manifest(folder, lambda manifest: manifest.update(files=checksums(folder)))


def edit_manifest(folder: Path, edit: Callable[[dict[str, Any]], Any]) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    edit(manifest)
    (folder / MANIFEST).write_text(json.dumps(manifest))


def edit_model(folder: Path, edit: Callable[[Arrays], Any]) -> None:
    with np.load(folder / MODEL) as stored:
        arrays = dict(stored)
    edit(arrays)
    np.savez(folder / MODEL, **arrays)
    sign(folder)


def test_what_was_written_is_read(tiny: Path) -> None:
    pack = load_pack(tiny)
    modes, model, trajectory, background = tiny_modes(), tiny_model(), tiny_trajectory(), tiny_background()
    half = {"rtol": 2**-10, "atol": 1e-3}  # half precision
    assert (pack.modes.width, pack.modes.height, pack.modes.count) == (24, 20, 5)
    for name in ("flow_mean", "flow_modes", "texture_mean", "texture_modes", "layer", "detail"):
        np.testing.assert_allclose(getattr(pack.modes, name), getattr(modes, name), **half)
    np.testing.assert_array_equal(pack.morphable.images, model.images)
    np.testing.assert_allclose(pack.morphable.flows, model.flows, **half)
    assert pack.morphable.reference == 1
    assert pack.trajectory.states == trajectory.states
    for name in ("mean", "precision", "offset", "scale"):
        np.testing.assert_allclose(getattr(pack.trajectory, name), getattr(trajectory, name), rtol=1e-6)
        assert getattr(pack.trajectory, name).dtype == np.float64
    for name in ("fps", "smoothness", "order", "lead", "cap"):
        assert getattr(pack.trajectory, name) == pytest.approx(getattr(trajectory, name))
    np.testing.assert_array_equal(pack.background.pictures, background.pictures)  # lossless
    assert (pack.background.crop, pack.background.region) == (background.crop, background.region)
    np.testing.assert_allclose(pack.background.pose, background.pose, **half)
    np.testing.assert_allclose(pack.background.mask, background.mask, atol=1 / 500)
    for array in (pack.modes.texture_modes, pack.background.pose, pack.morphable.flows):
        assert array.dtype == np.float32
        assert array.flags.c_contiguous


def test_the_shipped_pack_has_the_checksums_it_says() -> None:
    assert load_manifest(MARY).files == checksums(MARY)


def test_a_manifest_survives_being_written(tiny: Path, tmp_path: Path) -> None:
    manifest = load_manifest(tiny)
    write_manifest(tmp_path, manifest)
    assert load_manifest(tmp_path) == manifest
    assert (tmp_path / MANIFEST).read_text().endswith("}\n")


# Files


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file(pack: Path, name: str) -> None:
    (pack / name).unlink()
    with pytest.raises(BadPack, match=f"{name} is missing"):
        load_pack(pack)


@pytest.mark.parametrize("name", FILES)
def test_a_truncated_file(pack: Path, name: str) -> None:
    whole = (pack / name).read_bytes()
    (pack / name).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BadPack, match=f"{name} is damaged: its checksum differs") as raised:
        load_pack(pack)
    assert "Restore" in raised.value.advice


@pytest.mark.parametrize("name", FILES)
def test_a_flipped_bit(pack: Path, name: str) -> None:
    content = bytearray((pack / name).read_bytes())
    content[len(content) // 3] ^= 0x10
    (pack / name).write_bytes(content)
    with pytest.raises(BadPack, match=f"{name} is damaged"):
        load_pack(pack)


def test_a_symlink_even_to_the_right_file(pack: Path, tiny: Path) -> None:
    (pack / PREVIEW).unlink()
    (pack / PREVIEW).symlink_to(tiny / PREVIEW)
    with pytest.raises(BadPack, match="no plain file"):
        load_pack(pack)


def test_a_folder_in_place_of_a_file(pack: Path) -> None:
    (pack / PREVIEW).unlink()
    (pack / PREVIEW).mkdir()
    with pytest.raises(BadPack, match="no plain file"):
        load_pack(pack)


# Manifest


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda manifest: manifest.update(format=2), "manifest.json: format: Input should be 1"),
        (lambda manifest: manifest.pop("consent"), "manifest.json: consent: Field required"),
        (lambda manifest: manifest["consent"].update(statement=""), "manifest.json: consent.statement"),
        (lambda manifest: manifest.update(colour="red"), "manifest.json: colour: Extra inputs"),
        (lambda manifest: manifest.update(id="../tiny"), "manifest.json: id"),
        (lambda manifest: manifest.update(fps=0), "manifest.json: fps"),
        (lambda manifest: manifest.update(width=63), "manifest.json: width"),
        (lambda manifest: manifest.update(loop_frames=0), "manifest.json: loop_frames"),
        (lambda manifest: manifest.update(phone_set="IPA"), "manifest.json: phone_set"),
        (lambda manifest: manifest["files"].update({"../secret": "0"}), r"lists \['../secret', 'idle.mp4'"),
        (lambda manifest: manifest.update(files={f"../tiny/{name}": "0" for name in FILES}), "a pack has"),
        (lambda manifest: manifest["files"].pop(LOOP), "a pack has"),
        (lambda manifest: manifest["files"].update({MODEL: "0" * 64}), "model.npz is damaged"),
    ],
)
def test_a_wrong_manifest(pack: Path, edit: Callable[[dict[str, Any]], Any], message: str) -> None:
    edit_manifest(pack, edit)
    with pytest.raises(BadPack, match=message):
        load_pack(pack)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file: Invalid JSON"),
        (b"{", "the file: Invalid JSON"),
        (b"[]", "the file: Input should be an object"),
        (b"\xff\xfe\x00", "is no text"),
    ],
)
def test_a_manifest_that_is_none(pack: Path, content: bytes, message: str) -> None:
    (pack / MANIFEST).write_bytes(content)
    with pytest.raises(BadPack, match=message):
        load_pack(pack)


def test_no_manifest_or_a_folder_of_its_name(pack: Path) -> None:
    (pack / MANIFEST).unlink()
    with pytest.raises(BadPack, match="cannot be read: No such file"):
        load_pack(pack)
    (pack / MANIFEST).mkdir()
    with pytest.raises(BadPack, match="cannot be read: Is a directory"):
        load_pack(pack)


# Model


def put(name: str, value: object) -> Callable[[Arrays], None]:
    def edit(arrays: Arrays) -> None:
        arrays[name] = np.asarray(value)

    return edit


def change(name: str, how: Callable[[NDArray[Any]], NDArray[Any]]) -> Callable[[Arrays], None]:
    def edit(arrays: Arrays) -> None:
        arrays[name] = how(arrays[name])

    return edit


def spoil(value: float) -> Callable[[NDArray[Any]], NDArray[Any]]:
    def edit(array: NDArray[Any]) -> NDArray[Any]:
        array = array.astype(np.float64)
        array.flat[-1] = value
        return array

    return edit


NUMBERS = (
    "flow_mean", "flow_modes", "texture_mean", "texture_modes", "layer", "detail", "prototypes", "prototype_flows",
    "state_mean", "state_precision", "coefficient_offset", "coefficient_scale", "trajectory", "pose", "mask",
)  # fmt: skip
ARRAYS = (*NUMBERS, "size", "reference", "states", "crop", "region")


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_that_is_not_there(pack: Path, name: str) -> None:
    edit_model(pack, lambda arrays: arrays.pop(name))
    with pytest.raises(BadPack, match=f"model.npz lacks '{name}'") as raised:
        load_pack(pack)
    assert raised.value.advice == "Train the avatar again."


@pytest.mark.parametrize("name", NUMBERS)
def test_an_array_of_another_shape(pack: Path, name: str) -> None:
    edit_model(pack, change(name, lambda array: array[None]))
    with pytest.raises(BadPack, match=f"{name} has shape"):
        load_pack(pack)


@pytest.mark.parametrize("name", sorted(set(NUMBERS) - {"trajectory", "pose", "prototypes", "prototype_flows"}))
def test_an_array_that_is_too_short(pack: Path, name: str) -> None:
    edit_model(pack, change(name, lambda array: array[..., :-1]))
    with pytest.raises(BadPack, match="has shape"):
        load_pack(pack)


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_numbers_that_are_not_finite_or_too_large_for_a_float(pack: Path, name: str, value: float) -> None:
    edit_model(pack, change(name, spoil(value)))
    with pytest.raises(BadPack, match=f"{name} holds numbers that are not finite"):
        load_pack(pack)


@pytest.mark.parametrize("name", ["texture_mean", "pose", "size"])
def test_letters_in_place_of_numbers(pack: Path, name: str) -> None:
    edit_model(pack, change(name, lambda array: array.astype(str)))
    with pytest.raises(BadPack, match=f"{name} holds <U.*, expected numbers"):
        load_pack(pack)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (put("size", [24, 21]), "the mouth region is 24x21"),
        (put("size", [0, 20]), "the mouth region is 0x20"),
        (put("size", [4096, 20]), "the mouth region is 4096x20"),
        (put("size", [22, 20]), "flow_mean has shape"),
        (put("reference", [3]), "the reference is prototype 3 of 3"),
        (put("reference", [-1]), "the reference is prototype -1 of 3"),
        (put("states", ["AA", "M", "T"]), "the trajectory model has no silence"),
        (put("states", ["AA", "SIL"]), "state_mean has shape"),
        (put("states", "SIL"), "expected a row of names"),
        (put("states", [1, 2, 3]), "states holds int64 of shape"),
        (put("crop", [16, 12, 24, 2000]), "the crop Box.* leaves the picture"),
        (put("crop", [-16, 12, 24, 20]), "the crop Box.* leaves the picture"),
        (put("crop", [17, 12, 24, 20]), "is odd"),
        (put("crop", [16, 12, 22, 20]), "the crop is 22x20, the texture 24x20"),
        (put("region", [0, 0, 66, 20]), "the region Box.* leaves the picture"),
        (put("region", [8, 4, 0, 0]), "the region Box.* is empty"),
        (put("state_precision", np.zeros((3, 5))), "are out of range"),
        (put("coefficient_scale", -np.ones(5)), "are out of range"),
        (put("trajectory", [0, 2, 2, 0.05, 12]), "0 frames a second, the manifest says 25"),
        (put("trajectory", [25, 0, 2, 0.05, 12]), "are out of range"),
        (put("trajectory", [25, 2, 0, 0.05, 12]), "are out of range"),
        (put("trajectory", [25, 2, 99, 0.05, 12]), "are out of range"),
        (put("trajectory", [25, 2, 2, 0.05, 0]), "are out of range"),
        (put("trajectory", [30, 2, 2, 0.05, 12]), "30 frames a second, the manifest says 25"),
        (change("pose", lambda pose: pose[:-1]), "pose has shape"),
        (change("pose", lambda pose: pose[:, :0]), "pose has shape"),
        (change("pose", lambda pose: pose[:, :, 1:]), "pose has shape"),
    ],
)
def test_arrays_that_contradict_each_other(pack: Path, edit: Callable[[Arrays], None], message: str) -> None:
    edit_model(pack, edit)
    with pytest.raises(BadPack, match=message):
        load_pack(pack)


class Boom:
    """Leaves a trace if it is ever unpickled."""

    fired = False

    def __reduce__(self) -> tuple[Any, ...]:
        return (setattr, (Boom, "fired", True))


def test_a_pickle_in_the_model_is_not_opened(pack: Path) -> None:
    edit_model(pack, put("detail", np.array([Boom()], object)))
    with pytest.raises(BadPack, match="is no model"):
        load_pack(pack)
    assert not Boom.fired


def npz(entries: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return file.getvalue()


def npy_header(shape: tuple[int, ...]) -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return file.getvalue()


def damaged_zip() -> bytes:
    content = bytearray(npz({"size.npy": b"\x00" * 4096}, zipfile.ZIP_DEFLATED))
    content[45:60] = b"\xff" * 15  # inside the compressed stream
    return bytes(content)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"hello",
        b"PK\x03\x04 and no more",
        npz({"size.npy": b"not an array"}),
        npz({"size.npy": b""}),
        npz({"size.npy": npy_header((5,)) + b"\x00" * 8}),
        npz({"size.npy": npy_header((10**15,))}),
        npz({"size.npy": npy_header((-1,))}),
        damaged_zip(),
    ],
    ids=["empty", "text", "cut", "no array", "no header", "short", "huge", "negative", "bad stream"],
)
def test_a_model_file_that_is_no_model(pack: Path, content: bytes) -> None:
    (pack / MODEL).write_bytes(content)
    sign(pack)
    with pytest.raises(BadPack, match=r"model\.npz"):
        load_pack(pack)


def test_a_model_that_unpacks_to_gigabytes_is_refused_unread(pack: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.engine.pack.MOST_BYTES", 10_000)
    with pytest.raises(BadPack, match=r"unpacks to [0-9]+ bytes, more than 10000"):
        load_pack(pack)
    assert 20 * (MARY / MODEL).stat().st_size < MOST_BYTES


# Loop


def relooped(pack: Path, pictures: NDArray[np.uint8]) -> None:
    write_loop(pack / LOOP, pictures, 25)
    sign(pack)


def test_a_loop_with_too_few_frames(pack: Path) -> None:
    relooped(pack, tiny_background().pictures[:-1])
    with pytest.raises(BadPack, match=r"loop\.mkv has 4 frames, expected 5"):
        load_pack(pack)


def test_a_loop_with_too_many_frames(pack: Path) -> None:
    relooped(pack, np.repeat(tiny_background().pictures, 2, 0))
    with pytest.raises(BadPack, match=r"loop\.mkv has more frames"):
        load_pack(pack)


def test_a_loop_of_another_size(pack: Path) -> None:
    relooped(pack, tiny_background().pictures[:, :48, :32].copy())
    with pytest.raises(BadPack, match=r"loop\.mkv is 32x32, not 64x48"):
        load_pack(pack)


def test_a_manifest_of_a_giant_is_refused_before_memory_is_asked_for(pack: Path) -> None:
    edit_manifest(pack, lambda manifest: manifest.update(width=4096, height=4096, loop_frames=3000))
    with pytest.raises(BadPack, match=r"loop\.mkv is 64x48, not 4096x4096"):
        load_pack(pack)


@pytest.mark.parametrize("content", [b"", b"not a film"], ids=["empty", "text"])
def test_a_loop_that_is_no_film(pack: Path, content: bytes) -> None:
    (pack / LOOP).write_bytes(content)
    sign(pack)
    with pytest.raises(BadPack, match=r"loop\.mkv cannot be decoded"):
        load_pack(pack)


def test_a_loop_without_pictures(pack: Path) -> None:
    with av.open(str(pack / LOOP), "w", format="matroska") as output:
        stream = output.add_stream("pcm_s16le", rate=8000, layout="mono")
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        sound.sample_rate = 8000
        output.mux(stream.encode(sound))
        output.mux(stream.encode(None))
    sign(pack)
    with pytest.raises(BadPack, match=r"loop\.mkv cannot be decoded"):
        load_pack(pack)


def test_a_cut_loop_with_the_right_checksum(pack: Path) -> None:
    whole = (pack / LOOP).read_bytes()
    (pack / LOOP).write_bytes(whole[: len(whole) * 2 // 3])
    sign(pack)
    with pytest.raises(BadPack, match=r"loop\.mkv"):
        load_pack(pack)


def test_extreme_numbers_are_rounded_where_the_file_is_written(tmp_path: Path) -> None:
    model = replace(tiny_model(), images=tiny_model().images * 3 - 200)
    save_model(tmp_path / MODEL, tiny_modes(), model, tiny_trajectory(), tiny_background())
    with np.load(tmp_path / MODEL) as stored:
        np.testing.assert_array_equal(stored["prototypes"], np.clip(np.rint(model.images), 0, 255))
