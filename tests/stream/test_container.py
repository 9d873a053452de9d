from __future__ import annotations

from fractions import Fraction

from patterns import Studio

from app.stream.container import header


def test_flv_header() -> None:
    studio = Studio()
    data, time_bases = header("flv", {}, [studio.video.template, studio.aac.template])
    assert data.startswith(b"FLV\x01\x05")  # both sound and pictures
    assert time_bases == [Fraction(1, 1000)] * 2


def test_mp4_header() -> None:
    studio = Studio()
    options = {"movflags": "empty_moov+default_base_moof"}
    data, time_bases = header("mp4", options, [studio.video.template, studio.aac.template])
    assert data[4:8] == b"ftyp"
    assert b"avcC" in data
    assert b"esds" in data
    assert time_bases[0].denominator % 25 == 0
    assert time_bases[1] == Fraction(1, 48_000)


def test_headers_can_be_had_again_and_again() -> None:
    studio = Studio()
    templates = [studio.video.template, studio.aac.template]
    assert header("flv", {}, templates) == header("flv", {}, templates)
    assert studio.frame()  # and the encoders go on
