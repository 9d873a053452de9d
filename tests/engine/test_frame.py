from __future__ import annotations

import av
import numpy as np
import pytest
from av.video.reformatter import ColorRange, Colorspace
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine import frame

WHITE, BLACK, RED, GREEN, BLUE = (255, 255, 255), (0, 0, 0), (255, 0, 0), (0, 255, 0), (0, 0, 255)


def plain(colour: tuple[int, int, int], width: int = 8, height: int = 6) -> NDArray[np.uint8]:
    return np.tile(np.array(colour, np.uint8), (height, width, 1))


def smooth(seed: int, width: int = 64, height: int = 48) -> NDArray[np.uint8]:
    """A picture of slow waves of every colour."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width].astype(np.float64)
    waves = [
        128 + 90 * np.cos(x * random.uniform(0.02, 0.06) + y * random.uniform(0.02, 0.06) + random.uniform(0, 6))
        for _ in range(3)
    ]
    return np.rint(np.stack(waves, -1)).astype(np.uint8)


@pytest.mark.parametrize(
    ("colour", "levels"),
    [
        (WHITE, (235, 128, 128)),
        (BLACK, (16, 128, 128)),
        (RED, (63, 102, 240)),
        (GREEN, (173, 42, 26)),
        (BLUE, (32, 240, 118)),
        ((128, 128, 128), (126, 128, 128)),
    ],
)
def test_colours_have_the_levels_of_bt709_limited_range(
    colour: tuple[int, int, int], levels: tuple[int, int, int]
) -> None:
    for plane, level in zip(frame.planes(frame.from_rgb(plain(colour))), levels, strict=True):
        assert (plane == level).all(), (colour, plane[0, 0], level)


@given(st.tuples(*[st.integers(0, 255)] * 3))
@settings(max_examples=60, deadline=None)
def test_luma_and_chroma_follow_the_formula_of_bt709(colour: tuple[int, int, int]) -> None:
    r, g, b = (level / 255 for level in colour)
    y = 0.2126 * r + 0.7152 * g + 0.0722 * b
    expected = (16 + 219 * y, 128 + 224 * (b - y) / 1.8556, 128 + 224 * (r - y) / 1.5748)
    for plane, level in zip(frame.to_planes(plain(colour)), expected, strict=True):
        np.testing.assert_allclose(plane, level, atol=2e-3)


@pytest.mark.parametrize("seed", range(5))
def test_smooth_pictures_survive_the_round_trip(seed: int) -> None:
    rgb = smooth(seed)
    difference = np.abs(frame.to_rgb(frame.from_rgb(rgb)).astype(int) - rgb)
    assert difference[2:-2, 2:-2].max() <= 2
    assert difference.max() <= 8  # beyond the outermost chroma sample there is nothing to interpolate to


@pytest.mark.parametrize("seed", range(3))
def test_swscale_makes_nearly_the_same_picture(seed: int) -> None:
    # swscale sites chroma half a pixel further right, so the colours may differ by what they change in half a pixel.
    rgb = smooth(seed)
    theirs = av.VideoFrame.from_ndarray(rgb, format="rgb24").reformat(
        format="yuv420p",
        src_color_range=ColorRange.JPEG,
        dst_colorspace=Colorspace.ITU709,
        dst_color_range=ColorRange.MPEG,
    )
    ours = frame.planes(frame.from_rgb(rgb))
    for plane, (mine, other) in enumerate(zip(ours, frame.planes(theirs.to_ndarray()), strict=True)):
        difference = np.abs(mine.astype(int) - other)
        assert difference.max() <= (1 if plane == 0 else 3)
        assert abs(float(mine.mean()) - float(other.mean())) < 0.6


@pytest.mark.parametrize("colour", [WHITE, BLACK, RED, GREEN, BLUE, (200, 150, 130), (60, 20, 30)])
def test_swscale_shows_our_pictures_in_the_same_colours(colour: tuple[int, int, int]) -> None:
    sent = av.VideoFrame.from_ndarray(frame.from_rgb(plain(colour, 32, 16)), format="yuv420p")
    sent.colorspace, sent.color_range = Colorspace.ITU709, ColorRange.MPEG
    shown = sent.reformat(format="rgb24", dst_color_range=ColorRange.JPEG).to_ndarray()
    assert np.abs(shown.astype(int) - colour).max() <= 2


def test_chroma_lies_on_even_columns_between_two_rows() -> None:
    # A colour that is linear in place must be read at exactly (2 i, 2 j + 1/2).
    y, x = np.mgrid[:24, :40]
    rgb = np.stack([20 + 5 * x, np.full_like(x, 90), 30 + 4 * y], -1).astype(np.uint8)
    _, blue, red = frame.to_planes(rgb)
    row, column = np.mgrid[:12, :20].astype(np.float64)
    r, g, b = 20 + 5 * 2 * column, 90, 30 + 4 * (2 * row + 0.5)
    luma = 0.2126 * r + 0.7152 * g + 0.0722 * b
    inside = np.s_[:, 1:]  # the first column has only one neighbour
    np.testing.assert_allclose(blue[inside], (128 + 224 / 255 * (b - luma) / 1.8556)[inside], atol=2e-3)
    np.testing.assert_allclose(red[inside], (128 + 224 / 255 * (r - luma) / 1.5748)[inside], atol=2e-3)


@pytest.mark.parametrize(("edge", "weights"), [(8, (0, 0.75, 1)), (9, (0, 0.25, 1))])
def test_an_edge_that_moves_by_one_pixel_moves_in_the_chroma(edge: int, weights: tuple[float, ...]) -> None:
    rgb = plain(BLUE, 16, 4)
    rgb[:, edge:] = RED
    _, _, red = frame.to_planes(rgb)
    share = (red - red[0, 0]) / (red[0, -1] - red[0, 0])
    np.testing.assert_allclose(share[:, 3:6], np.tile(weights, (2, 1)), atol=1e-5)


def test_rows_are_averaged_in_pairs() -> None:
    rgb = plain(BLUE, 8, 8)
    rgb[3:] = RED
    _, _, red = frame.to_planes(rgb)
    share = (red - red[0, 0]) / (red[-1, 0] - red[0, 0])
    np.testing.assert_allclose(share[:, 0], [0, 0.5, 1, 1], atol=1e-5)


def test_planes_are_views_and_cover_the_picture() -> None:
    picture = frame.empty(12, 8)
    assert picture.shape == (12, 12)
    luma, blue, red = frame.planes(picture)
    assert (luma.shape, blue.shape, red.shape) == ((8, 12), (4, 6), (4, 6))
    luma[...], blue[...], red[...] = 1, 2, 3
    assert picture.reshape(-1).tolist() == [1] * 96 + [2] * 24 + [3] * 24


@pytest.mark.parametrize("size", [(7, 8), (8, 7)])
def test_odd_sides_are_refused(size: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="even"):
        frame.empty(*size)


def test_joining_rounds_and_clips() -> None:
    luma = np.full((2, 2), 99.6, np.float32)
    picture = frame.join(luma, np.full((1, 1), -4, np.float32), np.full((1, 1), 300, np.float32))
    assert [int(plane.flat[0]) for plane in frame.planes(picture)] == [100, 0, 255]
