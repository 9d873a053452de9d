from pathlib import Path

import hibari
import numpy as np
import onnxruntime
import pytest

from app.tts.onnx_output import expose, outputs_of


@pytest.fixture(scope="module")
def model() -> bytes:
    return (Path(hibari.__file__).parent / "assets/hibari.onnx").read_bytes()


def session(model: bytes) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def test_an_exposed_tensor_is_one_more_output_and_the_others_stay(model: bytes) -> None:
    (tensor,) = outputs_of(model, "Clip")
    before, after = session(model), session(expose(model, tensor))
    assert [o.name for o in after.get_outputs()] == [*(o.name for o in before.get_outputs()), tensor]
    feed = {"ids": np.array([[0, 50, 83, 54, 31, 0]], np.int64), "speed": np.ones(1, np.float32)}
    plain, *_, durations = before.run(None, feed)[0], *after.run(None, feed)
    np.testing.assert_array_equal(plain, after.run(None, feed)[0])
    assert durations.size == 6


def test_a_tensor_that_does_not_exist_is_refused_by_the_runtime(model: bytes) -> None:
    with pytest.raises(Exception, match="nowhere"):
        session(expose(model, "nowhere"))


def test_operators_that_are_not_there(model: bytes) -> None:
    assert outputs_of(model, "NoSuchOperator") == ()
    assert outputs_of(b"", "Clip") == ()


@pytest.mark.parametrize("damaged", [b"\xff" * 20, b"\x3a\xff", b"\x0f", b"\x3a\x05ab"])
def test_other_bytes_are_refused(damaged: bytes) -> None:
    with pytest.raises(ValueError, match="not an ONNX model"):
        outputs_of(damaged, "Clip")
    with pytest.raises(ValueError, match="not an ONNX model"):
        expose(damaged, "x")
