"""Makes an inner tensor of an ONNX model readable, without the `onnx` package.

A model file is a protocol buffer: nested fields, each a key (field number and wire type) and a value. An output is one
more field of the graph, so it can be appended to the bytes without understanding the rest; onnxruntime checks it.
"""

from __future__ import annotations

from collections.abc import Iterator

# Field numbers of onnx.proto.
_MODEL_GRAPH = 7
_GRAPH_NODE = 1
_GRAPH_OUTPUT = 12
_NODE_OUTPUT = 2
_NODE_OPERATOR = 4
_VALUE_NAME = 1

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5


def expose(model: bytes, tensor: str) -> bytes:
    """The same model with `tensor` appended to its outputs.

    Raises:
        ValueError: not an ONNX model.
    """
    parts: list[bytes] = []
    for number, value, whole in _fields(model):
        if number == _MODEL_GRAPH:
            output = _field(_GRAPH_OUTPUT, _field(_VALUE_NAME, tensor.encode()))
            parts.append(_field(_MODEL_GRAPH, value + output))
        else:
            parts.append(whole)
    return b"".join(parts)


def outputs_of(model: bytes, operator: str) -> tuple[str, ...]:
    """Names of the tensors that nodes of type `operator` make, in the graph's order.

    Raises:
        ValueError: not an ONNX model.
    """
    found: list[str] = []
    for number, graph, _ in _fields(model):
        if number != _MODEL_GRAPH:
            continue
        for kind, node, _ in _fields(graph):
            if kind != _GRAPH_NODE:
                continue
            fields = [(part, value) for part, value, _ in _fields(node)]
            if (_NODE_OPERATOR, operator.encode()) in fields:
                found += [value.decode() for part, value in fields if part == _NODE_OUTPUT]
    return tuple(found)


def _fields(message: bytes) -> Iterator[tuple[int, bytes, bytes]]:
    """Field number, content (empty unless the field is bytes) and the whole field of each field of a message."""
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


def _write_varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def _field(number: int, content: bytes) -> bytes:
    return _write_varint(number << 3 | _BYTES) + _write_varint(len(content)) + content
