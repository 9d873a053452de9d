from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from filmed import (
    IDLE,
    MOVING_HEAD,
    Rgb,
    idle,
    luma_of,
    moving_head,
    places,
    silence,
    similarity,
    speaking,
    spoken,
    vowel,
    warped,
    write_film,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine.background import Box
from app.engine.training import layout as module
from app.engine.training.face_detector import find_faces
from app.engine.training.layout import (
    CROP,
    Layout,
    face_mask,
    importance,
    lay_out,
    mouth_box,
    only_face,
)
from app.engine.training.take import Take
from app.errors import TrainingFailed

LIP = np.array([257.5, 327.5]) / 512 * 320 - 0.5
"""Where `speaking` has the middle of the lips."""


def take(folder: Path, name: str, pictures: tuple[Rgb, ...] | list[Rgb]) -> Take:
    return Take(name, write_film(folder / f"{name}.mp4", pictures), vowel(len(pictures)))


@pytest.fixture(scope="module")
def spoken_layout(tmp_path_factory: pytest.TempPathFactory) -> Layout:
    path = write_film(tmp_path_factory.mktemp("films") / "mary.mp4", speaking()[:100])
    return lay_out([Take("mary", path, spoken(100))])[0]


def middle(crop: Box) -> NDArray[np.float64]:
    return np.array([crop.x + (crop.width - 1) / 2, crop.y + (crop.height - 1) / 2])


def test_the_mouth_that_speaks_is_found(spoken_layout: Layout) -> None:
    assert np.linalg.norm(middle(spoken_layout.crop) - LIP) < 5  # an open mouth reaches down
    assert spoken_layout.size == (320, 320)
    assert spoken_layout.side == pytest.approx(161, abs=8)
    np.testing.assert_array_equal(spoken_layout.reference.shape, (480, 320))


def test_the_mouth_of_a_head_that_only_moves(tmp_path: Path) -> None:
    """Nobody speaks in Mary's loop: the mouth is where mouths usually are."""
    path = write_film(tmp_path / "idle.mp4", idle()[:50])
    found, refused = lay_out([Take("idle", path, silence(50))])
    assert refused == []
    assert np.linalg.norm(middle(found.crop) - places(IDLE, ["lip_mid"])[0, 0]) < 10


def test_the_mouth_of_a_moving_head(tmp_path: Path) -> None:
    found, _ = lay_out([take(tmp_path, "head", moving_head())])
    lips = places(MOVING_HEAD, ["lip_top", "lip_bottom", "mouth_l", "mouth_r"])[0].mean(0)
    assert np.linalg.norm(middle(found.crop) - lips) < 8


def test_the_first_take_with_one_face_gives_the_reference(tmp_path: Path) -> None:
    nobody = [np.full((320, 320, 3), 90, np.uint8)] * 20
    two = [np.hstack([rgb, rgb]) for rgb in speaking()[:20]]
    text = tmp_path / "text.mp4"
    text.write_text("no film")
    takes = [
        take(tmp_path, "nobody", nobody), take(tmp_path, "two", two), Take("text", text, vowel(20)),
        take(tmp_path, "mary", speaking()[:40]), take(tmp_path, "larger", idle()[:30]),
    ]  # fmt: skip
    found, refused = lay_out(takes)
    assert [(each.take, each.frame) for each in refused] == [("nobody", None), ("two", None), ("text", None)]
    assert ["no face" in refused[0].reason, "2 faces" in refused[1].reason, "decoded" in refused[2].reason] == [
        True
    ] * 3
    assert found.size == (320, 320)
    difference = found.reference[:320].astype(float) - luma_of(speaking()[0])
    assert np.abs(difference).mean() < 1
    # the side is of a face as large as the reference's, however large others are
    assert found.side == pytest.approx(161, abs=6)


def test_a_take_that_begins_without_a_face(tmp_path: Path) -> None:
    nobody = [np.full((320, 320, 3), 90, np.uint8)] * 30
    found, refused = lay_out([take(tmp_path, "late", [*nobody, *speaking()[:50]])])
    assert refused == []
    assert np.linalg.norm(middle(found.crop) - LIP) < 6


def test_without_any_face(tmp_path: Path) -> None:
    nobody = [np.full((320, 320, 3), 90, np.uint8)] * 10
    with pytest.raises(TrainingFailed, match="nobody: no face found") as raised:
        lay_out([take(tmp_path, "nobody", nobody)])
    assert "front" in raised.value.advice


def test_the_template_is_a_mean_of_steady_pictures(spoken_layout: Layout) -> None:
    """It is as sharp as one picture where the face does not move."""
    one = luma_of(speaking()[0]).astype(float)
    template = spoken_layout.template
    left, top, right, bottom = template.bounds
    assert template.scale == pytest.approx(150 / 161, abs=0.06)
    contrast = template.luma[top:bottom, left:right].std()
    rows, columns = (
        slice(round(start / template.scale), round(end / template.scale))
        for start, end in ((top, bottom), (left, right))
    )
    assert contrast > 0.9 * one[rows, columns].std()


@pytest.mark.parametrize(("x", "y"), [(-55, 0), (60, 0), (0, 38), (-55, 38), (60, 38), (0, -60)])
def test_a_crop_is_even_and_inside_with_the_face_at_an_edge(tmp_path: Path, x: int, y: int) -> None:
    moved = [warped(rgb, similarity(x, y)) for rgb in speaking()[:30]]
    found, _ = lay_out([take(tmp_path, "edge", moved)])
    crop = found.crop
    assert all(number % 2 == 0 for number in (crop.x, crop.y, crop.width, crop.height))
    assert crop.x >= 0
    assert crop.y >= 0
    assert crop.x + crop.width <= 320
    assert crop.y + crop.height <= 320
    assert (crop.width, crop.height) == tuple(2 * round(share * found.side / 2) for share in CROP)


@given(
    x=st.floats(-50, 700), y=st.floats(-50, 500), side=st.floats(20, 900),
    size=st.tuples(st.integers(48, 640), st.integers(48, 360)),
)  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_every_crop_is_even_and_inside(x: float, y: float, side: float, size: tuple[int, int]) -> None:
    size = (size[0] * 2, size[1] * 2)
    crop = module._crop(x, y, side, size)
    assert all(number % 2 == 0 and number >= 0 for number in (crop.x, crop.y, crop.width, crop.height))
    assert crop.x + crop.width <= size[0]
    assert crop.y + crop.height <= size[1]
    if crop.x > 0 and crop.x + crop.width < size[0]:
        assert abs(crop.x + crop.width / 2 - x) <= 1


@given(st.floats(60, 400))
@settings(max_examples=30, deadline=None)
def test_masks(side: float) -> None:
    width, height = (2 * round(share * side / 2) for share in CROP)
    crop = Box(10, 20, width, height)
    for mask in (face_mask(crop, side), importance(crop, side)):
        assert mask.shape == (height, width)
        assert mask.dtype == np.float32
        assert mask.min() >= 0
        assert mask[0, 0] == 0
        assert mask.max() <= 1 + 1e-6
        np.testing.assert_allclose(mask, mask[:, ::-1], atol=2e-6)
        np.testing.assert_allclose(mask, mask[::-1], atol=2e-6)
        assert (np.diff(mask[height // 2, : width // 2]) >= -1e-6).all()
        edge = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
        assert edge.max() < 0.02
    assert face_mask(crop, side)[height // 2, width // 2] == 1
    assert importance(crop, side)[height // 2, width // 2] > 0.9
    rows, columns = mouth_box(crop, side)
    assert 0 < rows.start < rows.stop < height
    assert 0 < columns.start < columns.stop < width
    assert face_mask(crop, side)[rows, columns].min() > 0.9


def test_only_one_face_is_the_face() -> None:
    luma = luma_of(idle()[0])
    assert only_face(luma, "here") == find_faces(luma)[0]
    with pytest.raises(TrainingFailed, match="here: 2 faces") as raised:
        only_face(np.hstack([luma, luma]), "here")
    assert "one person" in raised.value.advice
    with pytest.raises(TrainingFailed, match="here: no face found"):
        only_face(np.full((200, 200), 99, np.uint8), "here")
