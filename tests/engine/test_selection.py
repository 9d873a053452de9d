from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_samples import BREAK, add_samples, drawn_samples
from numpy.typing import NDArray

from app.engine.avatar import Avatar, load_avatar
from app.engine.background import Planes
from app.engine.frame import empty, planes
from app.engine.membrane import Membrane
from app.engine.pack import checksums, load_manifest, write_manifest
from app.engine.selection import REST, SelectionMouth, load_selection
from app.engine.selection_library import NAME, SampleLibrary
from app.engine.warp import sample
from app.errors import BadPack, NotFound
from app.speech import SILENCE, Phone

Float = NDArray[np.float32]
PHONES = (Phone(SILENCE, 0, 0.2), Phone("AA", 0.2, 0.8), Phone("M", 0.8, 1.2), Phone(SILENCE, 1.2, 1.6))


@pytest.fixture(scope="module")
def avatar(sampled: Path) -> Avatar:
    return load_avatar(sampled, "selection")


@pytest.fixture(scope="module")
def mouth(avatar: Avatar) -> SelectionMouth:
    return load_selection(avatar.pack)


@pytest.fixture(scope="module")
def library() -> SampleLibrary:
    return drawn_samples()


def shown(avatar: Avatar, row: Float | None, index: int) -> NDArray[np.uint8]:
    picture = empty(avatar.manifest.width, avatar.manifest.height)
    avatar.render(row, index, picture)
    return picture


@pytest.mark.parametrize("index", [-1, 0, 1, 2, 3])
def test_at_rest_every_pixel_is_the_loops(avatar: Avatar, index: int) -> None:
    assert np.array_equal(shown(avatar, avatar.rest, index), shown(avatar, None, index))


def test_what_is_planned_are_samples(avatar: Avatar, mouth: SelectionMouth, library: SampleLibrary) -> None:
    rows = avatar.trajectory(PHONES, 40)
    known = {row.tobytes() for row in (*library.rows, avatar.rest.astype(np.float32))}
    assert rows.shape == (40, 5)
    assert rows.dtype == np.float32
    assert all(row.tobytes() in known for row in rows)
    assert np.array_equal(mouth.plan(rows, None), rows)  # and they are planned again as they are


def test_a_stretch_of_the_recording_is_shown_as_recorded(mouth: SelectionMouth, library: SampleLibrary) -> None:
    noise = 0.05 * np.random.default_rng(0).standard_normal((12, 5)).astype(np.float32)
    assert np.array_equal(mouth.plan(library.rows[3:15] + noise, None), library.rows[3:15])


def test_a_plan_goes_on_from_what_was_shown(mouth: SelectionMouth, library: SampleLibrary) -> None:
    between = np.repeat((library.rows[5] + library.rows[BREAK + 5])[None] / 2, 2, 0)
    first, second = (mouth.plan(between, library.rows[start][None])[0] for start in (4, BREAK + 4))
    nothing = np.zeros((0, 5), np.float32)
    assert np.array_equal(mouth.plan(between, nothing), mouth.plan(between, None))
    assert not np.array_equal(first, second)


def test_a_row_that_is_no_sample_is_shown_by_the_nearest(mouth: SelectionMouth, library: SampleLibrary) -> None:
    assert mouth.number(library.rows[7]) == 8
    assert mouth.number(library.rows[7] + np.float32(1e-3)) == 8
    assert mouth.number(mouth._rows[REST]) == REST


@pytest.mark.parametrize(("index", "shift"), [(0, (0, 0)), (1, (3, -1)), (2, (-0.5, 1.25)), (3, (2.3, 0.7))])
def test_a_frame_is_the_sample_at_the_heads_pose_stitched_into_the_loop(
    avatar: Avatar, library: SampleLibrary, index: int, shift: tuple[float, float]
) -> None:
    # The literal way: move the sample with the head, then solve on the picture itself.
    background = avatar.pack.background
    loop = background.region.luma(shown(avatar, None, index)).astype(np.float32)
    mask, _ = background.posed_mask(index)
    size = library.width * library.height
    luma = library.pictures[11, :size].reshape(library.height, library.width).astype(np.float32)
    posed = sample(luma, background.backward(index))
    membrane = Membrane(mask > 0)
    literal = posed + membrane.stretch(membrane.trusted(loop - posed))
    literal = np.clip(loop + mask * (literal - loop), 0, 255)
    drawn = background.region.luma(shown(avatar, library.rows[11], index)).astype(np.float32)
    assert np.abs(drawn - loop)[mask > 0.9].mean() > 5
    assert np.sqrt((drawn - literal)[mask > 0].var()) < (1.0 if shift == (0, 0) else 2.5)
    assert np.array_equal(drawn[mask == 0], loop[mask == 0])


def test_the_mouth_is_as_sharp_as_the_sample(avatar: Avatar, library: SampleLibrary) -> None:
    inner = np.s_[7:13, 7:17]
    size = library.width * library.height
    luma = library.pictures[11, :size].reshape(library.height, library.width).astype(float)
    still = avatar.pack.background.crop.luma(shown(avatar, library.rows[11], -1)).astype(float)
    a, b = (cv2.Laplacian(each, cv2.CV_64F)[inner] for each in (luma, still))
    assert np.sqrt(((a - b) ** 2).mean()) < 0.15 * np.sqrt((a**2).mean())  # the coder, and rounding


def test_threads_draw_the_same(avatar: Avatar, library: SampleLibrary) -> None:
    def draw(number: int) -> NDArray[np.uint8]:
        return shown(avatar, library.rows[number % 9], number % 4)

    alone = [draw(number) for number in range(24)]
    with ThreadPoolExecutor(4) as pool:
        assert all(np.array_equal(a, b) for a, b in zip(alone, pool.map(draw, range(24)), strict=True))


def test_planes_of_chroma_are_drawn_too(avatar: Avatar, mouth: SelectionMouth, library: SampleLibrary) -> None:
    region = avatar.pack.background.region
    out = Planes.empty(region.width, region.height)
    mouth.draw(library.rows[11], avatar.pack.background.frames, out)
    crop = avatar.pack.background.crop
    x, y = (crop.x - region.x) // 2, (crop.y - region.y) // 2
    quarter = library.width * library.height // 4
    blue = library.pictures[11, 4 * quarter : 5 * quarter].reshape(library.height // 2, library.width // 2)
    drawn = out.blue[y : y + library.height // 2, x : x + library.width // 2]
    assert np.abs(drawn[2:-2, 2:-2] - blue[2:-2, 2:-2]).mean() < 2.5
    assert planes(shown(avatar, library.rows[11], 0))[1].shape == (24, 32)


def test_a_pack_without_samples_says_so(tiny: Path) -> None:
    with pytest.raises(NotFound, match="no samples") as caught:
        load_avatar(tiny, "selection")
    assert caught.value.field == "renderer"
    with pytest.raises(NotFound, match="no samples"):
        load_avatar(tiny).drawn_by("selection")


def test_a_damaged_library_is_refused(tmp_path: Path, tiny: Path) -> None:
    add_samples(tiny, tmp_path / "tiny")
    path = tmp_path / "tiny" / "models" / f"{NAME}.npz"
    path.write_bytes(path.read_bytes()[:-400])
    manifest = load_manifest(tmp_path / "tiny")
    write_manifest(tmp_path / "tiny", manifest.model_copy(update={"files": checksums(tmp_path / "tiny")}))
    assert load_avatar(tmp_path / "tiny").renderer == "fast"
    with pytest.raises(BadPack, match="selection"):
        load_avatar(tmp_path / "tiny", "selection")
