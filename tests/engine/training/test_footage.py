from __future__ import annotations

import struct
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest
from av.video.reformatter import ColorRange, Colorspace
from filmed import FPS, Rgb, idle, write_film
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine.frame import from_rgb, planes, to_rgb
from app.engine.training.footage import LONGEST_GAP, Shot, shots
from app.errors import TrainingFailed

FIRST, STEP = 20, 2
"""Luma of picture 0, and what every next one has more."""


def numbered(count: int) -> list[Rgb]:
    """Grey pictures of luma 20, 22, ..."""
    levels = [(FIRST + STEP * (n % 100) - 16) * 255 / 219 for n in range(count)]
    return [np.full((96, 128, 3), round(level), np.uint8) for level in levels]


def numbers(path: Path) -> list[int]:
    """Which pictures of `numbered` are shown at each tick."""
    return [round((float(planes(shot.picture)[0].mean()) - FIRST) / STEP) for shot in shots(path)]


def seen(path: Path) -> list[Shot]:
    return [Shot(shot.picture.copy(), shot.fresh) for shot in shots(path)]


def nearest(times: list[float], tick: float) -> set[int]:
    """Pictures whose time is nearest to a tick: two where they are about equally near."""
    off = np.abs(np.array(times) - tick)
    return set(np.flatnonzero(off < off.min() + 2e-3).tolist())


@pytest.mark.parametrize("rate", [24, 25, 30, 50, 60, Fraction(30000, 1001), 12])
def test_every_tick_shows_the_picture_nearest_to_it(tmp_path: Path, rate: int | Fraction) -> None:
    count = int(1.6 * rate)
    shown = numbers(write_film(tmp_path / "film.mp4", numbered(count), rate=rate))
    times = [n / float(rate) for n in range(count)]
    assert abs(len(shown) - times[-1] * FPS - 1) <= 1
    for number, picture in enumerate(shown):
        if rate >= 24:
            assert picture in nearest(times, number / FPS), number
        else:  # the next picture is not shown long before its time
            assert -1 / 50 <= number / FPS - times[picture] <= 1 / 12
    if rate == FPS:
        assert shown == list(range(count))


@given(st.lists(st.floats(0.008, 0.09), min_size=5, max_size=40), st.floats(0, 3))
@settings(max_examples=15, deadline=None)
def test_a_variable_rate(tmp_path_factory: pytest.TempPathFactory, gaps: list[float], start: float) -> None:
    times = [0.0, *np.cumsum(gaps).tolist()]
    path = tmp_path_factory.mktemp("films") / "film.mkv"
    write_film(path, numbered(len(times)), times=[start + time for time in times])
    exact = [round((start + time) * 1000) / 1000 - round(start * 1000) / 1000 for time in times]  # Matroska's
    for number, picture in enumerate(numbers(path)):
        tick = number / FPS
        on_screen = max((n for n, time in enumerate(exact) if time <= tick + 1.5e-3), default=0)
        assert abs(exact[picture] - tick) <= 0.0215 or picture == on_screen
        if max(gaps) <= 0.02:
            assert abs(exact[picture] - tick) <= min(abs(time - tick) for time in exact) + 1.5e-3
    assert numbers(path) == sorted(numbers(path))


def test_a_picture_stays_on_where_others_are_missing(tmp_path: Path) -> None:
    times = [n / FPS for n in (0, 1, 2, 7, 8, 9)]
    write_film(tmp_path / "film.mkv", numbered(6), times=times)
    assert numbers(tmp_path / "film.mkv") == [0, 1, 2, 2, 2, 2, 2, 3, 4, 5]
    assert [shot.fresh for shot in shots(tmp_path / "film.mkv")] == [True] * 3 + [False] * 4 + [True] * 3


def test_a_clock_that_leaps_does_not_fill_hours_with_one_picture(tmp_path: Path) -> None:
    times = [0, 0.04, 0.08, 3600 + LONGEST_GAP, 3600 + LONGEST_GAP + 0.04]
    assert numbers(write_film(tmp_path / "film.mkv", numbered(5), times=times)) == [0, 1, 2, 3, 4]


def test_reordered_pictures_come_in_the_order_they_are_seen(tmp_path: Path) -> None:
    options = {"preset": "medium", "bf": "3", "g": "12"}
    shown = numbers(write_film(tmp_path / "film.mp4", numbered(40), options=options))
    assert shown == list(range(40))


def test_pictures_are_the_houses(tmp_path: Path) -> None:
    picture = seen(write_film(tmp_path / "film.mp4", idle()[:1]))[0].picture
    assert (picture.shape, picture.dtype, picture.flags.c_contiguous) == ((768, 512), np.uint8, True)
    difference = picture.astype(int) - from_rgb(idle()[0])
    assert np.abs(difference).mean() < 0.6


# --- colours ----------------------------------------------------------------------------------------------------------

COLOURS = [(255, 255, 255), (0, 0, 0), (200, 60, 30), (30, 190, 60), (40, 60, 210), (220, 180, 150), (128, 128, 128)]
BT601, BT709, SMPTE240 = (0.299, 0.114), (0.2126, 0.0722), (0.212, 0.087)


def levels(colour: tuple[int, int, int], constants: tuple[float, float], full: bool) -> tuple[int, int, int]:
    """Luma and chroma of a colour by the definition of these systems."""
    red, green, blue = (level / 255 for level in colour)
    kr, kb = constants
    y = kr * red + (1 - kr - kb) * green + kb * blue
    pb, pr = (blue - y) / (2 * (1 - kb)), (red - y) / (2 * (1 - kr))
    scaled = (255 * y, 128 + 255 * pb, 128 + 255 * pr) if full else (16 + 219 * y, 128 + 224 * pb, 128 + 224 * pr)
    return tuple(min(255, round(level)) for level in scaled)  # type: ignore[return-value]


def write_planes(
    path: Path, colour: tuple[int, int, int], *, space: Colorspace | None, full: bool, height: int = 128,
    pixels: str = "yuv420p",
) -> None:  # fmt: skip
    constants = {Colorspace.ITU709: BT709, Colorspace.SMPTE240M: SMPTE240, Colorspace.ITU601: BT601}
    chosen = constants[space] if space is not None else (BT709 if height >= 720 else BT601)
    y, blue, red = levels(colour, chosen, full)
    width = height
    with av.open(str(path), "w") as output:
        stream = output.add_stream("ffv1", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = width, height, pixels
        if space is not None:
            stream.codec_context.colorspace = space
        stream.codec_context.color_range = ColorRange.JPEG if full else ColorRange.MPEG
        flat = [np.full(height * width, y), np.full(height * width // 4, blue), np.full(height * width // 4, red)]
        picture = np.concatenate(flat).astype(np.uint8).reshape(height * 3 // 2, width)
        frame = av.VideoFrame.from_ndarray(picture, format=pixels)
        frame.color_range = ColorRange.JPEG if full else ColorRange.MPEG
        if space is not None:
            frame.colorspace = space
        output.mux(stream.encode(frame))
        output.mux(stream.encode(None))


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize(
    ("space", "height"),
    [(Colorspace.ITU709, 128), (Colorspace.ITU601, 128), (Colorspace.SMPTE240M, 128), (None, 128), (None, 720)],
)
def test_colours_are_those_of_the_system_the_file_names(
    tmp_path: Path, space: Colorspace | None, height: int, full: bool
) -> None:
    for number, colour in enumerate(COLOURS):
        path = tmp_path / f"{number}.mkv"
        write_planes(path, colour, space=space, full=full, height=height)
        for plane, level in zip(planes(seen(path)[0].picture), levels(colour, BT709, False), strict=True):
            assert np.abs(plane.astype(int) - level).max() <= 2, (colour, plane[5, 5], level)


@pytest.mark.parametrize(
    ("codec", "pixels"), [("ffv1", "bgr0"), ("png", "rgb24"), ("mjpeg", "yuvj444p"), ("qtrle", "argb")]
)
def test_colours_of_other_codecs(tmp_path: Path, codec: str, pixels: str) -> None:
    for number, colour in enumerate(COLOURS):
        path = tmp_path / f"{number}.mov"
        path = path.with_suffix(".mkv") if codec == "ffv1" else path
        with av.open(str(path), "w") as output:
            stream = output.add_stream(codec, rate=FPS)
            stream.width, stream.height, stream.pix_fmt = 128, 96, pixels
            if pixels == "yuvj444p":
                each = [np.full((96, 128), level, np.uint8) for level in levels(colour, BT601, True)]
                frame = av.VideoFrame.from_ndarray(np.stack(each), format=pixels)
            else:
                frame = av.VideoFrame.from_ndarray(np.full((96, 128, 3), colour, np.uint8), format="rgb24")
                frame = frame.reformat(format=pixels)
            output.mux(stream.encode(frame))
            output.mux(stream.encode(None))
        for plane, level in zip(planes(seen(path)[0].picture), levels(colour, BT709, False), strict=True):
            assert np.abs(plane.astype(int) - level).max() <= 2, (colour, plane[5, 5], level)


# --- sizes and rotation -----------------------------------------------------------------------------------------------


def blocks(width: int, height: int) -> Rgb:
    """A picture with a bright, a middle and a dark corner (upper left, upper right, lower left) and one between."""
    rgb = np.empty((height, width, 3), np.uint8)
    half = (slice(None, height // 2), slice(height // 2, None)), (slice(None, width // 2), slice(width // 2, None))
    for (row, column), level in {(0, 0): 230, (0, 1): 150, (1, 0): 20, (1, 1): 80}.items():
        rgb[half[0][row], half[1][column]] = level
    return rgb


def corners(picture: NDArray[np.uint8]) -> list[list[int]]:
    """The grey levels in the quarters of a picture, as `blocks` has them, nearest."""
    rgb = to_rgb(picture)
    height, width = rgb.shape[:2]
    each = [[int(rgb[height * y // 4, width * x // 4, 1]) for x in (1, 3)] for y in (1, 3)]
    return [[min((230, 150, 20, 80), key=lambda level: abs(level - one)) for one in row] for row in each]


@pytest.mark.parametrize(
    ("width", "height", "expected"),
    [(128, 96, (128, 96)), (131, 97, (132, 96)), (130, 99, (130, 100)), (1920, 1080, (1280, 720)),
     (1080, 1920, (720, 1280)), (1280, 720, (1280, 720)), (1440, 1080, (960, 720)), (2000, 400, (1280, 256))],
)  # fmt: skip
def test_sizes(tmp_path: Path, width: int, height: int, expected: tuple[int, int]) -> None:
    rgb = blocks(width, height)
    with av.open(str(tmp_path / "film.mkv"), "w") as output:
        stream = output.add_stream("ffv1", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = width, height, "bgr0"
        output.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24").reformat(format="bgr0")))
        output.mux(stream.encode(None))
    picture = seen(tmp_path / "film.mkv")[0].picture
    assert (picture.shape[1], picture.shape[0] * 2 // 3) == expected
    assert corners(picture) == [[230, 150], [20, 80]]


def test_a_tiny_picture_is_refused(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "film.mkv"), "w") as output:
        stream = output.add_stream("ffv1", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = 200, 94, "yuv420p"
        output.mux(stream.encode(av.VideoFrame(200, 94, "yuv420p")))
        output.mux(stream.encode(None))
    with pytest.raises(TrainingFailed, match=r"film.mkv is 200x94: too small") as raised:
        seen(tmp_path / "film.mkv")
    assert "96" in raised.value.advice


DISPLAYED = {
    90: ((0, 1, -1, 0), [[20, 230], [80, 150]]),
    180: ((-1, 0, 0, -1), [[80, 20], [150, 230]]),
    270: ((0, -1, 1, 0), [[150, 80], [230, 20]]),
}
"""By degrees clockwise: a, b, c, d of the track's matrix (x' = a x + c y, y' = b x + d y), and how `blocks` is seen."""


@pytest.mark.parametrize("degrees", DISPLAYED)
def test_a_telephone_held_otherwise_is_turned_upright(tmp_path: Path, degrees: int) -> None:
    matrix, expected = DISPLAYED[degrees]
    path = write_film(tmp_path / "film.mp4", [blocks(160, 120)] * 3)
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 4 + 40  # version 0: 40 bytes before the matrix
    one = struct.pack(">9i", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)
    assert data[at : at + 36] == one
    a, b, c, d = (number * 0x10000 for number in matrix)
    data[at : at + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 0x40000000)
    path.write_bytes(data)
    for shot in seen(path):
        assert shot.picture.shape == ((180, 160) if degrees == 180 else (240, 120))
        assert corners(shot.picture) == expected


# --- damage -----------------------------------------------------------------------------------------------------------


def packets(path: Path) -> list[tuple[int, int]]:
    """Place and size of the video's packets."""
    with av.open(str(path)) as container:
        return [(packet.pos, packet.size) for packet in container.demux(video=0) if packet.size]


def test_damage_in_the_middle_leaves_the_rest(tmp_path: Path) -> None:
    path = write_film(tmp_path / "film.mp4", idle()[:50], options={"g": "10", "crf": "20"})
    whole = seen(path)
    data = bytearray(path.read_bytes())
    random = np.random.default_rng(1)
    for at, size in packets(path)[22:26]:
        for place in random.integers(at + 8, at + size, 200):
            data[place] ^= int(random.integers(1, 256))
    path.write_bytes(data)
    spoilt = seen(path)
    assert len(spoilt) == 50
    for number in (*range(20), *range(30, 50)):
        np.testing.assert_array_equal(spoilt[number].picture, whole[number].picture)
        assert spoilt[number].fresh == whole[number].fresh


def test_a_packet_that_cannot_be_decoded_leaves_the_picture_before(tmp_path: Path) -> None:
    path = write_film(tmp_path / "film.mp4", numbered(20), options={"g": "1"})
    data = bytearray(path.read_bytes())
    at, size = packets(path)[7]
    data[at : at + size] = bytes(size)
    path.write_bytes(data)
    shown = list(shots(path))
    assert numbers(path) == [*range(7), 6, *range(8, 20)]
    assert [number for number, shot in enumerate(shown) if not shot.fresh] == [7]


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_a_film_that_breaks_off_is_used_as_far_as_it_goes(tmp_path: Path, share: float) -> None:
    path = write_film(tmp_path / "film.mkv", idle()[:30])
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    assert 30 * share - 8 <= len(seen(path)) < 30


def test_an_mp4_without_its_end_cannot_be_decoded(tmp_path: Path) -> None:
    path = write_film(tmp_path / "film.mp4", numbered(10))
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(TrainingFailed, match=r"film.mp4"):
        seen(path)


def silent_film(path: Path) -> None:
    with av.open(str(path), "w") as output:
        stream = output.add_stream("aac", rate=16000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        sound.sample_rate = 16000
        output.mux(stream.encode(sound))
        output.mux(stream.encode(None))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path.write_text("My film is not ready yet.\n" * 40), "film.mp4 cannot be decoded"),
        (lambda path: path.write_text("[00:00.00] FFmpeg reads these as lyrics.\n" * 40), "film.mp4 has no pictures"),
        (lambda path: path.write_bytes(b""), "film.mp4 cannot be decoded"),
        (lambda path: path.write_bytes(np.random.default_rng(0).bytes(20000)), "film.mp4 cannot be decoded"),
        (lambda _: None, "film.mp4 cannot be decoded: .*No such file"),
        (lambda path: path.mkdir(), "film.mp4 cannot be decoded"),
        (silent_film, "film.mp4 has no pictures in it"),
    ],
)
def test_what_is_no_film(tmp_path: Path, make: Callable[[Path], object], message: str) -> None:
    make(tmp_path / "film.mp4")
    with pytest.raises(TrainingFailed, match=message) as raised:
        seen(tmp_path / "film.mp4")
    assert str(tmp_path) not in raised.value.message


def test_a_film_of_which_no_picture_can_be_decoded(tmp_path: Path) -> None:
    path = write_film(tmp_path / "film.mp4", numbered(5))
    data = bytearray(path.read_bytes())
    for at, size in packets(path):
        data[at : at + size] = bytes(size)
    path.write_bytes(data)
    with pytest.raises(TrainingFailed, match=r"film.mp4 has no picture that can be decoded"):
        seen(path)


def test_shots_are_made_one_by_one(tmp_path: Path) -> None:
    """Hours of film do not fit into memory."""
    path = write_film(tmp_path / "film.mp4", numbered(20))
    first = [next(shots(path)) for _ in range(2)]
    np.testing.assert_array_equal(first[0].picture, first[1].picture)
    for before, after in pairwise(seen(path)):
        assert not np.array_equal(before.picture, after.picture)
