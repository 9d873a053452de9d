"""Makes an inner tensor of an ONNX model readable, without the `onnx` package.

An output is one more field of the graph, so it can be appended to the bytes without understanding the rest; onnxruntime
checks it.
"""

from __future__ import annotations

from app.onnx_fields import field, fields

# Field numbers of onnx.proto.
_MODEL_GRAPH = 7
_GRAPH_NODE = 1
_GRAPH_OUTPUT = 12
_NODE_OUTPUT = 2
_NODE_OPERATOR = 4
_VALUE_NAME = 1


def expose(model: bytes, tensor: str) -> bytes:
    """The same model with `tensor` appended to its outputs.

    Raises:
        ValueError: not an ONNX model.
    """
    parts: list[bytes] = []
    for number, value, whole in fields(model):
        if number == _MODEL_GRAPH:
            output = field(_GRAPH_OUTPUT, field(_VALUE_NAME, tensor.encode()))
            parts.append(field(_MODEL_GRAPH, value + output))
        else:
            parts.append(whole)
    return b"".join(parts)


def outputs_of(model: bytes, operator: str) -> tuple[str, ...]:
    """Names of the tensors that nodes of type `operator` make, in the graph's order.

    Raises:
        ValueError: not an ONNX model.
    """
    found: list[str] = []
    for number, graph, _ in fields(model):
        if number != _MODEL_GRAPH:
            continue
        for kind, node, _ in fields(graph):
            if kind != _GRAPH_NODE:
                continue
            parts = [(part, value) for part, value, _ in fields(node)]
            if (_NODE_OPERATOR, operator.encode()) in parts:
                found += [value.decode() for part, value in parts if part == _NODE_OUTPUT]
    return tuple(found)
