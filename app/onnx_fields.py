"""The fields of an ONNX model file, without the `onnx` package.

Such a file is a protocol buffer: nested fields, each a key (field number and wire type) and a value.
"""

from __future__ import annotations

from collections.abc import Iterator

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5  # wire types


def fields(message: bytes) -> Iterator[tuple[int, bytes, bytes]]:
    """Field number, content (empty unless the field is bytes) and the whole field of each field of a message.

    Raises:
        ValueError: it is none.
    """
    at = 0
    while at < len(message):
        start = at
        key, at = _read_varint(message, at)
        wire, content = key & 7, b""
        if wire == _VARINT:
            _, at = _read_varint(message, at)
        elif wire == _BYTES:
            size, at = _read_varint(message, at)
            content = message[at : at + size]
            at += size
        elif wire in (_FIXED64, _FIXED32):
            at += 8 if wire == _FIXED64 else 4
        else:
            raise ValueError(f"not an ONNX model: wire type {wire} at byte {start}")
        if at > len(message):
            raise ValueError("not an ONNX model: a field is cut short")
        yield key >> 3, content, message[start:at]


def field(number: int, content: bytes) -> bytes:
    """A field of bytes: text, packed numbers or another message."""
    return _varint(number << 3 | _BYTES) + _varint(len(content)) + content


def integer(number: int, value: int) -> bytes:
    """A field that is a whole number, not negative."""
    return _varint(number << 3 | _VARINT) + _varint(value)


def _read_varint(message: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while at < len(message) and shift < 64:
        byte = message[at]
        at += 1
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value, at
    raise ValueError("not an ONNX model: a number is cut short")


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)
