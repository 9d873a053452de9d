from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st
from patterns import picture

from app.stream.encoder import VideoEncoder
from app.stream.nal import length_prefixed, unit_type, units

# What emulation prevention allows: no three-byte sequence 000000..000003, and a last byte that is not zero.
_UNITS = st.lists(
    st.tuples(st.integers(1, 6), st.binary(min_size=1, max_size=60)).map(
        lambda unit: bytes([unit[0]]) + re.sub(rb"\x00\x00[\x00-\x03]", b"\x00\x01\x05", unit[1]) + b"\x80"
    ),
    max_size=8,
)


@given(_UNITS, st.data())
def test_units_come_back(wanted: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(data.draw(st.sampled_from([b"\0\0\1", b"\0\0\0\1", b"\0\0\0\0\1"])) + unit for unit in wanted)
    if any(re.search(rb"\x00\x00[\x00-\x03]", unit) for unit in wanted):
        return  # replacing made a new one
    assert units(stream) == wanted


@given(_UNITS)
def test_length_prefixes_give_the_units_back(wanted: list[bytes]) -> None:
    if any(re.search(rb"\x00\x00[\x00-\x03]", unit) for unit in wanted):
        return
    data = length_prefixed(b"".join(b"\0\0\0\1" + unit for unit in wanted))
    read = []
    while data:
        size = int.from_bytes(data[:4], "big")
        read.append(data[4 : 4 + size])
        data = data[4 + size :]
    assert read == wanted


@given(st.binary(max_size=100))
def test_any_bytes_are_survived(data: bytes) -> None:
    length_prefixed(data)


def test_parameter_sets_are_left_out() -> None:
    packet = VideoEncoder(128, 128, 25).encode(picture(0), 0)[0]
    assert {unit_type(unit) for unit in units(packet.data)} >= {7, 8, 5}
    kept = length_prefixed(packet.data)
    types = []
    while kept:
        types.append(kept[4] & 0x1F)
        kept = kept[4 + int.from_bytes(kept[:4], "big") :]
    assert set(types) <= {5, 6}
    assert 5 in types
