from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_phone_mean import FPS, REST, said

from app.engine.models.model_file import load_trajectory, save_trajectory
from app.engine.models.phone_mean import PhoneMeanKind
from app.engine.models.registry import fit
from app.errors import BadPack
from app.speech import Phone

KIND = PhoneMeanKind()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "models" / "phone-mean.npz"
    model = fit("phone-mean", [said("AA", "B", "S", "AA", "B", "AA")], REST, fps=FPS)
    save_trajectory(path, KIND, model.to_arrays(), modes="abc")
    return path


def change(path: Path, **arrays: object) -> None:
    with np.load(path) as stored:
        everything = {name: stored[name] for name in stored.files}
    np.savez(path, **{name: each for name, each in (everything | arrays).items() if each is not None})


def test_what_was_stored_is_read(file: Path) -> None:
    model = load_trajectory(file, KIND, modes="abc", count=2)
    assert model.name == "phone-mean"
    assert model.predict([Phone("AA", 0, 1)], 4).shape == (4, 2)


@pytest.mark.parametrize(
    ("changed", "problem"),
    [
        ({"kind_version": np.array([7])}, "of version 7, this program reads version 1"),
        ({"kind": np.array(["hmm"])}, "a model of the kind hmm"),
        ({"modes_digest": np.array(["xyz"])}, "for other mouths"),
        ({"kind_version": None}, "lacks 'kind_version'"),
        ({"model_mean": None}, "lacks 'mean'"),
        ({"model_mean": np.zeros((2, 9))}, r"mean has shape \(2, 9\)"),
        ({"model_mean": np.full((4, 2), np.inf)}, "not finite"),
        ({"model_mean": np.array([["a"]])}, "mean"),
        ({"model_rest": np.zeros(3), "model_mean": np.zeros((4, 3))}, "3 coefficients, the pack's mouths 2"),
    ],
)
def test_what_is_wrong_is_said(file: Path, changed: dict[str, object], problem: str) -> None:
    change(file, **changed)
    with pytest.raises(BadPack, match=problem):
        load_trajectory(file, KIND, modes="abc", count=2)


def test_objects_are_refused(file: Path) -> None:
    change(file, model_mean=np.array([None, {}], object))
    with pytest.raises(BadPack, match="is no model"):
        load_trajectory(file, KIND, modes="abc", count=2)


def test_no_archive_at_all(tmp_path: Path) -> None:
    (tmp_path / "x.npz").write_bytes(b"no archive")
    with pytest.raises(BadPack, match="is no model"):
        load_trajectory(tmp_path / "x.npz", KIND, modes="abc", count=2)
