from __future__ import annotations

import numpy as np
import pytest

from app.engine.models.network_layers import forward, random_weights
from app.engine.models.network_onnx import INPUT, MOST_BYTES, check_onnx, session, to_onnx

FEATURES, HIDDEN, OUT = 9, 8, 5


@pytest.fixture(scope="module")
def networks() -> list[dict[str, np.ndarray]]:
    random = np.random.default_rng(0)
    found = [random_weights(FEATURES, HIDDEN, OUT, random) for _ in range(3)]
    for each in found:
        for name in ("b0", "b1", "b2", "b"):
            each[name] = random.standard_normal(each[name].shape).astype(np.float32)
    return found


@pytest.mark.parametrize("frames", [1, 4, 50])
def test_the_exported_ensemble_says_the_mean_of_its_members(networks: list[dict[str, np.ndarray]], frames: int) -> None:
    x = np.random.default_rng(1).standard_normal((frames, FEATURES)).astype(np.float32)
    expected = np.mean([forward(each, x[None]).out[0] for each in networks], 0)
    np.testing.assert_allclose(session(to_onnx(networks)).run(None, {INPUT: x})[0], expected, atol=1e-5)


@pytest.mark.parametrize("count", [1, 2])
def test_it_is_written_alike_every_time(networks: list[dict[str, np.ndarray]], count: int) -> None:
    assert to_onnx(networks[:count]) == to_onnx(networks[:count])
    check_onnx(to_onnx(networks[:count]))


def test_what_computes_something_else_is_refused(networks: list[dict[str, np.ndarray]]) -> None:
    with pytest.raises(ValueError, match="something else"):
        check_onnx(to_onnx(networks).replace(b'"\x04Relu', b'"\x04Tanh'))


def test_an_ensemble_of_too_many_is_refused(networks: list[dict[str, np.ndarray]]) -> None:
    with pytest.raises(ValueError, match="something else"):
        check_onnx(to_onnx(networks * 6))


@pytest.mark.parametrize(
    ("extra", "told"),
    [
        (b"\xca\x01\x00", "part 25 that is not needed"),  # a function
        (b"\x3a\x06\x2a\x04\x6a\x02\x0a\x00", "in another file"),  # a graph with weights that name one
        (b"\x3a\x04\x7a\x02\x08\x01", "graph holds a part 15"),  # a graph with sparse weights
    ],
)
def test_other_parts_are_refused(networks: list[dict[str, np.ndarray]], extra: bytes, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        check_onnx(to_onnx(networks) + extra)


@pytest.mark.parametrize("broken", [b"no model", b"\x3a\xff", bytes(MOST_BYTES + 1), b""])
def test_what_is_no_model_is_refused(broken: bytes) -> None:
    with pytest.raises(ValueError):
        session(broken)


def test_a_model_cut_short_is_refused(networks: list[dict[str, np.ndarray]]) -> None:
    with pytest.raises(ValueError):
        session(to_onnx(networks)[:-20])
