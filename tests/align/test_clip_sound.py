from __future__ import annotations

from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from films import click, clicks, film
from locked import lock

from app.align.clip_sound import read_clip_sound
from app.errors import InputError

AAC: dict[str, Any] = {"codec": "aac", "form": "fltp"}
MP2: dict[str, Any] = {"codec": "mp2", "form": "s16", "rate": 48_000}


def heard(path: Path) -> list[float]:
    sound = read_clip_sound(path)
    assert sound.samples.dtype == np.float32
    assert sound.samples.ndim == 1
    assert np.abs(sound.samples).max() <= 1.0
    return clicks(sound.samples, sound.rate)


# --- the clock --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "settings"),
    [("a.mkv", {}), ("a.mp4", AAC), ("a.mov", AAC), ("a.avi", {}), ("a.ts", MP2), ("a.mpg", MP2)],
)
@pytest.mark.parametrize("sound_at", [0.0, 0.48])
def test_sound_is_where_the_container_puts_it(tmp_path: Path, name: str, settings: Any, sound_at: float) -> None:
    if name == "a.avi" and sound_at:
        pytest.skip("AVI has no timestamps")
    rate = settings.get("rate", 16_000)
    path = film(tmp_path / name, click(2.0, 1.0, rate), **{"rate": rate, **settings}, sound_at=sound_at)
    assert heard(path) == pytest.approx([1.0 + sound_at], abs=0.002)


def test_silence_stands_before_sound_that_begins_late(tmp_path: Path) -> None:
    sound = read_clip_sound(film(tmp_path / "a.mkv", click(2.0, 1.0), sound_at=0.5))
    assert sound.start == 0.5
    assert sound.duration == 2.5
    assert not sound.samples[:8000].any()
    assert sound.lost == 0.0


@pytest.mark.parametrize(("name", "settings"), [("a.mkv", {}), ("a.mp4", AAC)])
def test_sound_before_the_first_picture_is_cut_off(tmp_path: Path, name: str, settings: Any) -> None:
    path = film(tmp_path / name, click(2.0, 1.0), **settings, picture_at=0.32)
    assert heard(path) == pytest.approx([0.68], abs=0.002)
    assert read_clip_sound(path).start == pytest.approx(-0.32)


def test_pictures_that_cannot_be_decoded_do_not_count(tmp_path: Path) -> None:
    """The first half of the pictures is lost with the key picture that they need."""
    whole, cut = film(tmp_path / "whole.mkv", click(2.0, 1.5), picture="mpeg2video"), tmp_path / "cut.mkv"
    with av.open(str(whole)) as source, av.open(str(cut), "w") as output:
        streams = {each.index: output.add_stream_from_template(each) for each in source.streams}
        for packet in source.demux():
            if packet.dts is None or (packet.stream.type == "video" and packet.pts * packet.time_base < 0.3):
                continue
            packet.stream = streams[packet.stream.index]
            output.mux(packet)
    start = read_clip_sound(cut).start
    assert start < -0.4  # the next key picture, not the first that is in the file
    assert heard(cut) == pytest.approx([1.5 + start], abs=0.002)


def test_gaps_are_silence_and_shift_nothing(tmp_path: Path) -> None:
    path = film(tmp_path / "a.mkv", click(3.0, 2.0), change=lambda number, packet: None if 5 <= number < 9 else packet)
    sound = read_clip_sound(path)
    assert heard(path) == [2.0]
    assert sound.lost == pytest.approx(4 * 1024 / 16_000, abs=0.001)


def test_damaged_packets_are_silence_and_shift_nothing(tmp_path: Path) -> None:
    def damage(number: int, packet: Any) -> Any:
        if not 20 <= number < 25:
            return packet
        junk = av.Packet(bytes(packet.size))
        junk.pts, junk.dts, junk.time_base, junk.stream = packet.pts, packet.dts, packet.time_base, packet.stream
        return junk

    path = film(tmp_path / "a.mkv", click(4.0, 3.5), **AAC, change=damage)
    assert heard(path) == pytest.approx([3.5], abs=0.002)
    assert read_clip_sound(path).lost == pytest.approx(5 * 1024 / 16_000, abs=0.001)


def test_a_clock_that_jumps_far_ahead_is_refused(tmp_path: Path) -> None:
    def shift(number: int, packet: Any) -> Any:
        if number >= 30:
            packet.pts += round(700 / packet.time_base)
            packet.dts = packet.pts
        return packet

    with pytest.raises(InputError, match=r"clock of its sound jumps by \+700\.0 s at 1\.9 s"):
        read_clip_sound(film(tmp_path / "a.mkv", click(3.0, 2.0), change=shift))


def test_a_clock_that_is_set_back_is_refused(tmp_path: Path) -> None:
    one = film(tmp_path / "one.ts", click(2.0, 1.0, 48_000), **MP2)
    both = tmp_path / "both.ts"
    both.write_bytes(one.read_bytes() * 2)
    with pytest.raises(InputError, match=r"clock of its sound jumps by -2\.0 s at 2\.0 s"):
        read_clip_sound(both)


# --- what sound there is ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("codec", "form"), [("pcm_u8", "u8"), ("pcm_s16le", "s16"), ("pcm_s32le", "s32"), ("pcm_f32le", "flt")]
)
@pytest.mark.parametrize("rate", [8_000, 22_050, 48_000])
def test_any_format_and_rate(tmp_path: Path, codec: str, form: str, rate: int) -> None:
    path = film(tmp_path / "a.mkv", click(1.0, 0.5, rate), rate, codec=codec, form=form)
    sound = read_clip_sound(path)
    assert (sound.rate, len(sound.samples)) == (rate, rate)
    assert heard(path) == [0.5]
    assert np.abs(sound.samples).max() == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(
    ("layout", "channel"), [("stereo", None), ("stereo", 0), ("stereo", 1), ("5.1", 2), ("5.1", 0), ("quad", None)]
)
def test_channels_are_mixed(tmp_path: Path, layout: str, channel: int | None) -> None:
    assert heard(film(tmp_path / "a.mkv", click(1.0, 0.5), layout=layout, channel=channel)) == [0.5]


def test_channels_and_rate_may_change(tmp_path: Path) -> None:
    """Two transport streams one after the other, as of a broadcast."""
    one = film(tmp_path / "one.ts", click(2.0, 1.0, 48_000), 48_000, codec="mp2", layout="stereo")
    other = film(tmp_path / "other.ts", click(2.0, 1.0, 44_100), 44_100, codec="mp2", sound_at=2.0, picture_at=2.0)
    both = tmp_path / "both.ts"
    both.write_bytes(one.read_bytes() + other.read_bytes())
    sound = read_clip_sound(both)
    assert sound.rate == 48_000
    assert heard(both) == pytest.approx([1.0, 3.0], abs=0.03)


# --- what cannot be read ----------------------------------------------------------------------------------------------


def test_a_film_that_is_cut_off_says_so(tmp_path: Path) -> None:
    path = film(tmp_path / "a.mp4", click(4.0, 1.0), **AAC, options={"movflags": "faststart"})
    data = path.read_bytes()
    path.write_bytes(data[: data.index(b"mdat") + (len(data) - data.index(b"mdat")) // 2])
    sound = read_clip_sound(path)
    assert heard(path) == pytest.approx([1.0], abs=0.002)
    assert sound.lost == pytest.approx(4.0 - sound.duration, abs=0.1)
    assert sound.lost > 0.5


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "it is empty"),
        (b"hello, this is text\n" * 50, "cannot be read as a video"),
        (b"#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n", "cannot be read as a video"),
        (bytes(range(256)) * 40, "cannot be read as a video"),
        (None, "cannot be opened: No such file"),
    ],
)
def test_what_is_no_video_is_explained(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "a.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_clip_sound(path)


def test_a_film_cut_off_before_its_index_is_explained(tmp_path: Path) -> None:
    path = film(tmp_path / "a.mp4", click(2.0, 1.0), **AAC)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match="nothing is in it"):
        read_clip_sound(path)


def test_a_folder_is_explained(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be"):
        read_clip_sound(tmp_path)


def test_a_locked_file_is_explained(tmp_path: Path) -> None:
    path = film(tmp_path / "a.mkv", click(1.0, 0.5))
    lock(path)
    with pytest.raises(InputError, match="cannot be opened: Permission denied"):
        read_clip_sound(path)


def test_without_sound_or_picture_it_is_explained(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="it has no sound"):
        read_clip_sound(film(tmp_path / "silent.mp4", None))
    with pytest.raises(InputError, match="it has no picture"):
        read_clip_sound(film(tmp_path / "radio.mp4", click(1.0, 0.5), **AAC, picture=""))


def test_sound_or_pictures_of_which_nothing_can_be_decoded(tmp_path: Path) -> None:
    def damage(_: int, packet: Any) -> Any:
        junk = av.Packet(bytes(packet.size))
        junk.pts, junk.dts, junk.time_base, junk.stream = packet.pts, packet.dts, packet.time_base, packet.stream
        return junk

    with pytest.raises(InputError, match="none of its sound can be decoded"):
        read_clip_sound(film(tmp_path / "a.mkv", click(1.0, 0.5), **AAC, change=damage))


def test_sound_that_ends_before_the_picture_begins(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="ends before its first picture"):
        read_clip_sound(film(tmp_path / "a.mkv", click(1.0, 0.5), picture_at=2.0))
