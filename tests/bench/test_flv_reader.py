from __future__ import annotations

import itertools
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.flv_reader import AUDIO, VIDEO, FlvReader, Tag

SCRIPT = 18
HEADER = b"FLV\x01\x05\0\0\0\x09\0\0\0\0"


def tag(kind: int, milliseconds: int, body: bytes) -> bytes:
    time = struct.pack(">I", milliseconds)
    head = bytes([kind]) + struct.pack(">I", len(body))[1:] + time[1:] + time[:1] + bytes(3)
    return head + body + struct.pack(">I", len(head) + len(body))


STREAM = HEADER + b"".join(
    [
        tag(SCRIPT, 0, b"\x02\0\x0aonMetaData"),
        tag(VIDEO, 0, b"\x17\0\0\0\0header"),
        tag(AUDIO, 0, b"\xaf\0header"),
        tag(VIDEO, 40, b"\x17\x01\0\0\x28picture"),  # shown 40 ms after it is decoded
        tag(AUDIO, 43, b"\xaf\x01sound"),
        tag(VIDEO, 0x01020304, b"\x27\x01\xff\xff\xfe"),
    ]
)
FOUND = [(VIDEO, 0.08), (AUDIO, 0.043), (VIDEO, (0x01020304 - 2) / 1000)]


@given(st.lists(st.integers(0, len(STREAM)), max_size=20))
def test_packets_are_found_however_they_arrive(cuts: list[int]) -> None:
    places = [0, *sorted(cuts), len(STREAM)]
    reader = FlvReader()
    found = [
        each for start, end in itertools.pairwise(places) for each in reader.feed(STREAM[start:end], arrived=float(end))
    ]
    assert [(each.kind, each.seconds) for each in found] == FOUND
    ends = [STREAM.index(part) + len(part) + 4 for part in (b"picture", b"sound", b"\xff\xff\xfe")]
    assert [each.arrived for each in found] == [min(place for place in places if place >= end) for end in ends]


def test_a_packet_is_told_with_its_last_byte() -> None:
    reader = FlvReader()
    whole = HEADER + tag(AUDIO, 5, b"\xaf\x01x")
    assert list(reader.feed(whole[:-1], 1.0)) == []
    assert list(reader.feed(whole[-1:], 2.0)) == [Tag(AUDIO, 0.005, 2.0)]


def test_something_else_is_refused() -> None:
    with pytest.raises(ValueError, match="no FLV"):
        list(FlvReader().feed(b"RIFF" + bytes(20), 0.0))
    with pytest.raises(ValueError, match="as long as"):
        list(FlvReader().feed(HEADER + tag(AUDIO, 0, b"\xaf\x01x")[:-1] + b"\0", 0.0))
