from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.onnx_fields import field, fields, integer

NUMBERS = st.integers(1, 2**20)


@given(st.lists(st.tuples(NUMBERS, st.binary(max_size=300) | st.integers(0, 2**63 - 1)), max_size=6))
def test_what_is_written_is_read(parts: list[tuple[int, bytes | int]]) -> None:
    written = [field(number, value) if isinstance(value, bytes) else integer(number, value) for number, value in parts]
    found = list(fields(b"".join(written)))
    assert [number for number, _, _ in found] == [number for number, _ in parts]
    assert [content for _, content, _ in found] == [each if isinstance(each, bytes) else b"" for _, each in parts]
    assert [whole for _, _, whole in found] == written


def test_the_bytes_are_those_of_protocol_buffers() -> None:
    # The examples of the format's own description: field 1 is 150; field 2 is "testing".
    assert integer(1, 150) == bytes.fromhex("089601")
    assert field(2, b"testing") == bytes.fromhex("120774657374696e67")


@given(st.binary(max_size=60))
def test_anything_else_is_refused_or_read_whole(message: bytes) -> None:
    try:
        found = list(fields(message))
    except ValueError as error:
        assert "not an ONNX model" in str(error)  # noqa: PT017
    else:
        assert b"".join(whole for _, _, whole in found) == message


def test_fixed_numbers_are_passed_over_and_groups_are_not_known() -> None:
    assert list(fields(b"\x09" + bytes(8) + b"\x15" + bytes(4))) == [
        (1, b"", b"\x09" + bytes(8)),
        (2, b"", b"\x15" + bytes(4)),
    ]
    with pytest.raises(ValueError, match="wire type 3 at byte 0"):
        list(fields(b"\x0b"))
