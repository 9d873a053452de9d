"""Networks as ONNX: written without the `onnx` package, and run only if they compute what is written here.

A model file is a protocol buffer: nested fields, each a key (field number and wire type) and a value. The networks of
an ensemble become one graph, side by side in grouped convolutions, so that one call runs them all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from app.engine.models.network_layers import CONVOLUTIONS, WIDTH, Weights
from app.onnx_fields import field, fields, integer

Float = NDArray[np.float32]

INPUT, OUTPUT = "features", "mouths"
MOST_BYTES = 32 * 2**20
"""Of a network; ours have about two million."""
MOST_MEMBERS = 16
"""Of an ensemble."""
IR_VERSION, OPSET = 8, 13

# Field numbers of onnx.proto.
_MODEL_IR, _MODEL_PRODUCER, _MODEL_GRAPH, _MODEL_OPSET = 1, 2, 7, 8
_GRAPH_NODE, _GRAPH_NAME, _GRAPH_WEIGHTS, _GRAPH_INPUT, _GRAPH_OUTPUT = 1, 2, 5, 11, 12
_NODE_INPUT, _NODE_OUTPUT, _NODE_OPERATOR, _NODE_ATTRIBUTE = 1, 2, 4, 5
_ATTRIBUTE_NAME, _ATTRIBUTE_INT, _ATTRIBUTE_INTS, _ATTRIBUTE_TYPE = 1, 3, 8, 20
_TENSOR_SHAPE, _TENSOR_TYPE, _TENSOR_NAME, _TENSOR_RAW, _TENSOR_EXTERNAL = 1, 2, 8, 9, 13
_INT, _INTS = 2, 7  # attribute types
_FLOAT32, _INT64 = 1, 7  # tensor types


def to_onnx(networks: Sequence[Weights]) -> bytes:
    """The mean of some networks of one shape as an ONNX model: `features` (T, F) to `mouths` (T, K)."""
    features, hidden = networks[0]["w0"].shape
    out, count = networks[0]["w"].shape[1], len(networks)
    weights: dict[str, NDArray[Any]] = {
        "w0": np.concatenate([each["w0"] for each in networks], 1),
        "b0": np.concatenate([each["b0"] for each in networks]),
        "w": np.concatenate([each["w"] for each in networks]).T[:, :, None] / np.float32(count),
        "b": np.mean([each["b"] for each in networks], 0),
        "axis": np.zeros(1, np.int64),
    }
    for layer in range(1, CONVOLUTIONS + 1):
        kernels = [each[f"w{layer}"].reshape(WIDTH, hidden, hidden).transpose(2, 1, 0) for each in networks]
        weights |= {
            f"w{layer}": np.concatenate(kernels),
            f"b{layer}": np.concatenate([each[f"b{layer}"] for each in networks]),
        }
    graph = b"".join(field(_GRAPH_NODE, node) for node in _nodes(count))
    graph += field(_GRAPH_NAME, b"network")
    graph += b"".join(field(_GRAPH_WEIGHTS, _tensor(name, array)) for name, array in weights.items())
    graph += field(_GRAPH_INPUT, _value(INPUT, features)) + field(_GRAPH_OUTPUT, _value(OUTPUT, out))
    opset = integer(2, OPSET)
    return (
        integer(_MODEL_IR, IR_VERSION) + field(_MODEL_PRODUCER, b"mary") + field(_MODEL_GRAPH, graph)
        + field(_MODEL_OPSET, opset)
    )  # fmt: skip


def check_onnx(model: bytes) -> None:
    """Refuse what `to_onnx` would not write, before a line of it is run.

    Raises:
        ValueError: it is too large, no ONNX model, computes something else, or its weights lie in other files.
    """
    if len(model) > MOST_BYTES:
        raise ValueError(f"it has {len(model)} bytes, more than {MOST_BYTES}")
    known = {_MODEL_IR, _MODEL_PRODUCER, _MODEL_GRAPH, _MODEL_OPSET}
    for number, content, _ in fields(model):
        if number not in known:  # functions, for example: operators by another name
            raise ValueError(f"it holds a part {number} that is not needed")
        if number == _MODEL_GRAPH:
            _check_graph(content)


def session(model: bytes) -> onnxruntime.InferenceSession:
    """It made ready to run in one thread.

    Raises:
        ValueError: see `check_onnx`, or onnxruntime cannot run it.
    """
    check_onnx(model)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what is wrong is said by the exception
    try:
        made = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # its exceptions share no base
        raise ValueError(str(error)) from error
    names = [[each.name for each in side] for side in (made.get_inputs(), made.get_outputs())]
    if names != [[INPUT], [OUTPUT]]:
        raise ValueError(f"it turns {names[0]} into {names[1]}")
    return made


def _nodes(members: int) -> list[bytes]:
    """What is computed, whatever the weights are."""
    nodes = [
        _node("Gemm", ["features", "w0", "b0"], "read"),
        _node("Relu", ["read"], "rows"),
        _node("Transpose", ["rows"], "columns", perm=[1, 0]),
        _node("Unsqueeze", ["columns", "axis"], "hidden0"),
    ]
    for layer in range(1, CONVOLUTIONS + 1):
        inputs = [f"hidden{layer - 1}", f"w{layer}", f"b{layer}"]
        nodes += [
            _node("Conv", inputs, f"moved{layer}", group=members, kernel_shape=[WIDTH], pads=[WIDTH - 1, 0]),
            _node("Relu", [f"moved{layer}"], f"added{layer}"),
            _node("Add", [f"hidden{layer - 1}", f"added{layer}"], f"hidden{layer}"),
        ]
    return [
        *nodes,
        _node("Conv", [f"hidden{CONVOLUTIONS}", "w", "b"], "said", kernel_shape=[1]),
        _node("Squeeze", ["said", "axis"], "turned"),
        _node("Transpose", ["turned"], OUTPUT, perm=[1, 0]),
    ]


def _check_graph(graph: bytes) -> None:
    known = {_GRAPH_NODE, _GRAPH_NAME, _GRAPH_WEIGHTS, _GRAPH_INPUT, _GRAPH_OUTPUT}
    nodes = []
    for number, content, _ in fields(graph):
        if number not in known:
            raise ValueError(f"its graph holds a part {number} that is not needed")
        if number == _GRAPH_NODE:
            nodes.append(content)
        if number == _GRAPH_WEIGHTS and any(part >= _TENSOR_EXTERNAL for part, _, _ in fields(content)):
            raise ValueError("its weights lie in another file")
    if not any(nodes == _nodes(members) for members in range(1, MOST_MEMBERS + 1)):
        raise ValueError("it computes something else than our networks")


def _node(operator: str, inputs: Sequence[str], output: str, **attributes: int | list[int]) -> bytes:
    node = b"".join(field(_NODE_INPUT, name.encode()) for name in inputs)
    node += field(_NODE_OUTPUT, output.encode()) + field(_NODE_OPERATOR, operator.encode())
    for name, value in attributes.items():
        attribute = field(_ATTRIBUTE_NAME, name.encode())
        if isinstance(value, int):
            attribute += integer(_ATTRIBUTE_INT, value) + integer(_ATTRIBUTE_TYPE, _INT)
        else:
            attribute += b"".join(integer(_ATTRIBUTE_INTS, each) for each in value)
            attribute += integer(_ATTRIBUTE_TYPE, _INTS)
        node += field(_NODE_ATTRIBUTE, attribute)
    return node


def _tensor(name: str, array: NDArray[Any]) -> bytes:
    kind = _INT64 if array.dtype == np.int64 else _FLOAT32
    raw = np.ascontiguousarray(array, "<i8" if kind == _INT64 else "<f4").tobytes()
    shape = b"".join(integer(_TENSOR_SHAPE, size) for size in array.shape)
    return shape + integer(_TENSOR_TYPE, kind) + field(_TENSOR_NAME, name.encode()) + field(_TENSOR_RAW, raw)


def _value(name: str, columns: int) -> bytes:
    """A table of some rows: ValueInfo of a type of a tensor of float32 and a shape of one name and one number."""
    shape = field(1, field(2, b"frames")) + field(1, integer(1, columns))
    return field(1, name.encode()) + field(2, field(1, integer(1, _FLOAT32) + field(2, shape)))
