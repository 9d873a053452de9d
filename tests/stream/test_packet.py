from __future__ import annotations

import dataclasses
from fractions import Fraction

import pytest

from app.stream.packet import Packet

PACKET = Packet("video", b"abc", pts=50, dts=49, duration=1, time_base=Fraction(1, 25), keyframe=True)


def test_seconds_are_presentation_time() -> None:
    assert PACKET.seconds == 2.0


def test_only_key_frames_start() -> None:
    assert PACKET.starts
    assert not dataclasses.replace(PACKET, keyframe=False).starts
    assert not dataclasses.replace(PACKET, kind="aac").starts


def test_packets_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        PACKET.pts = 3  # type: ignore[misc]


def test_to_av_copies_everything() -> None:
    copied = PACKET.to_av()
    assert bytes(copied) == b"abc"
    assert (copied.pts, copied.dts, copied.duration, copied.time_base) == (50, 49, 1, Fraction(1, 25))
    assert copied.is_keyframe
    copied.pts = 7
    assert PACKET.pts == 50
