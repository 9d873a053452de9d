from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.engine.training import workspace as module
from app.engine.training.frame_store import FrameStore
from app.engine.training.workspace import Arrays, Workspace, key
from app.errors import TrainingStopped

ONE: Arrays = {
    "floats": np.linspace(0, 1, 7, dtype=np.float32), "flags": np.array([True, False]),
    "none": np.empty((0, 3), np.int64), "text": np.array(["a hand", "grey: …"]), "number": np.array(3.5),
}  # fmt: skip
A, B = key("a"), key("b")


class Counted:
    """Computes arrays and says how often."""

    def __init__(self, arrays: Arrays = ONE) -> None:
        self.calls, self.arrays = 0, arrays

    def __call__(self) -> Arrays:
        self.calls += 1
        return self.arrays


def same(found: Arrays | None, expected: Arrays) -> None:
    assert found is not None
    assert found.keys() == expected.keys()
    for name, array in expected.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


@pytest.fixture
def space(tmp_path: Path) -> Workspace:
    return Workspace(tmp_path / "of" / ".work")


def files(space: Workspace) -> list[str]:
    return sorted(path.name for path in space.folder.iterdir())


# --- arrays -----------------------------------------------------------------------------------------------------------


def test_a_step_is_computed_once(space: Workspace) -> None:
    compute = Counted()
    same(space.step("layout", A, compute), ONE)
    same(space.step("layout", A, compute), ONE)
    same(Workspace(space.folder).step("layout", A, compute), ONE)
    same(space.kept("layout", A), ONE)
    assert compute.calls == 1


def test_what_was_never_kept(space: Workspace) -> None:
    assert space.kept("layout", A) is None
    space.keep("layout", A, ONE)
    assert space.kept("layout", B) is None
    assert space.kept("survey1", A) is None


def test_results_with_other_keys_are_removed_those_of_other_steps_are_not(space: Workspace) -> None:
    for name in ("survey1", "survey11", "survey1-more", "survey"):
        space.keep(name, A, ONE)
    space.keep("survey1", B, ONE)
    assert space.kept("survey1", A) is None
    same(space.kept("survey1", B), ONE)
    for name in ("survey11", "survey1-more", "survey"):
        same(space.kept(name, A), ONE)


def test_nothing_pickled_is_kept(space: Workspace) -> None:
    with pytest.raises(ValueError, match="allow_pickle"):
        space.keep("layout", A, {"objects": np.array([object()])})
    assert files(space) == []


class Stopped(BaseException):
    """As an interrupt from the keyboard."""


def test_an_interrupted_write_is_not_there(space: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    space.keep("layout", A, ONE)

    def half(file: Any, **_: object) -> None:
        file.write(b"PK\x03\x04 and no more")
        raise Stopped

    monkeypatch.setattr(np, "savez", half)
    with pytest.raises(Stopped):
        space.keep("layout", B, ONE)
    monkeypatch.undo()
    assert space.kept("layout", B) is None
    same(space.kept("layout", A), ONE)
    assert files(space) == [f"layout-{A}.npz"]


def test_an_interrupted_computation_keeps_nothing(space: Workspace) -> None:
    def stop() -> Arrays:
        raise Stopped

    with pytest.raises(Stopped):
        space.step("layout", A, stop)
    assert space.kept("layout", A) is None


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_a_damaged_file_is_as_good_as_none(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    space = Workspace(tmp_path_factory.mktemp("space"))
    space.keep("layout", A, ONE)
    path = space.folder / f"layout-{A}.npz"
    whole = bytearray(path.read_bytes())
    at = data.draw(st.integers(0, len(whole) - 1))
    if data.draw(st.booleans()):
        path.write_bytes(whole[:at])
    else:
        whole[at] ^= data.draw(st.integers(1, 255))
        path.write_bytes(whole)
    found = space.kept("layout", A)
    for name, array in (found or {}).items():  # a flipped bit in a date does no harm
        if name in ONE:
            np.testing.assert_array_equal(array, ONE[name])
    compute = Counted()
    if found is None:
        same(space.step("layout", A, compute), ONE)
        assert compute.calls == 1
        same(space.kept("layout", A), ONE)


def full(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk(space: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    space.keep("layout", A, ONE)
    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(TrainingStopped, match=r"/of/\.work cannot be written: No space left on device") as raised:
        space.keep("layout", B, ONE)
    assert "Make room" in raised.value.advice
    assert files(space) == [f"layout-{A}.npz"]


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(TrainingStopped, match="cannot be made: Not a directory"):
        Workspace(tmp_path / "file" / "work").keep("layout", A, ONE)


def test_everything_is_removed(space: Workspace) -> None:
    space.remove()
    space.keep("layout", A, ONE)
    space.remove()
    assert not space.folder.exists()
    assert space.kept("layout", A) is None


# --- frames -----------------------------------------------------------------------------------------------------------


def fill(level: int) -> Callable[[FrameStore], None]:
    return lambda store: store.write(0, np.full((len(store), *store.shape), level, np.uint8))


def refuse(_: FrameStore) -> None:
    pytest.fail("it was filled before")


def test_a_store_is_filled_once(space: Workspace) -> None:
    first = space.store("frames", A, 5, (4,), np.uint8, fill(7))
    again = space.store("frames", A, 5, (4,), np.uint8, refuse)
    assert first == again
    assert (again.read(0, 5) == 7).all()


def test_a_store_that_was_not_filled_to_the_end_is_filled_again(space: Workspace) -> None:
    def half(store: FrameStore) -> None:
        store.write(0, np.full((2, 4), 9, np.uint8))
        raise Stopped

    with pytest.raises(Stopped):
        space.store("frames", A, 5, (4,), np.uint8, half)
    assert files(space) == []
    assert (space.store("frames", A, 5, (4,), np.uint8, fill(7)).read(0, 5) == 7).all()


def test_a_store_whose_writer_was_killed_is_filled_again(space: Workspace) -> None:
    space.store("frames", A, 5, (4,), np.uint8, fill(9))
    (space.folder / f"frames-{A}.done").unlink()  # what is left when nothing can be tidied up
    assert (space.store("frames", A, 5, (4,), np.uint8, fill(7)).read(0, 5) == 7).all()


def test_a_store_of_another_length_is_filled_again(space: Workspace) -> None:
    store = space.store("frames", A, 5, (4,), np.uint8, fill(9))
    with store.path.open("r+b") as file:
        file.truncate(13)
    assert (space.store("frames", A, 5, (4,), np.uint8, fill(7)).read(0, 5) == 7).all()


def test_older_stores_make_room_and_others_stay(space: Workspace) -> None:
    for name in ("frames", "frames-more"):
        space.store(name, A, 5, (4,), np.uint8, fill(9))
    space.store("frames", B, 5, (4,), np.uint8, fill(7))
    ends = ("done", "rows")
    assert files(space) == sorted([f"frames-more-{A}.{end}" for end in ends] + [f"frames-{B}.{end}" for end in ends])


def test_no_room_for_a_store(space: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(TrainingStopped, match="cannot be written: No space left on device"):
        space.store("frames", A, 5, (4,), np.uint8, refuse)
    assert files(space) == []


def test_a_failure_of_the_filling_itself_is_told_as_it_is(space: Workspace) -> None:
    def fail(_: FrameStore) -> None:
        raise TrainingStopped("a process of the training was killed")

    with pytest.raises(TrainingStopped, match="was killed"):
        space.store("frames", A, 5, (4,), np.uint8, fail)


# --- keys -------------------------------------------------------------------------------------------------------------


def test_keys_change_with_every_part(monkeypatch: pytest.MonkeyPatch) -> None:
    array = np.arange(6, dtype=np.int32)
    parts: list[tuple[Any, ...]] = [
        (), (1,), ("1",), (1, 2), ([1, 2],), (12,), (None,), (True,), (1.5,), ("a", "b"), ("ab",), (["a"], "b"),
        ({"a": 1},), ({"a": 2},), (array,), (array.astype(np.int64),), (array.astype(np.uint32),),
        (array.reshape(2, 3),), (array.reshape(3, 2),), (array[::-1],), (array, array), ([array],), (np.arange(2000),),
        ([np.arange(2000)],),
        ([np.r_[np.arange(1000), 0, np.arange(1001, 2000)]],), (Path("/a"),), (Path("/b"),),
    ]  # fmt: skip
    keys = [key(*part) for part in parts]
    assert len(set(keys)) == len(keys)
    assert all(len(each) == 16 for each in keys)
    assert keys == [key(*part) for part in parts]
    monkeypatch.setattr(module, "VERSION", module.VERSION + 1)
    assert not set(keys) & {key(*part) for part in parts}


def test_keys_are_of_values_not_of_their_storage() -> None:
    array = np.arange(12).reshape(3, 4)
    assert key(array.T) == key(np.ascontiguousarray(array.T))
    assert key({"a": 1, "b": 2}) == key({"b": 2, "a": 1})
    assert key((1, 2)) == key([1, 2])
    assert key(np.int64(3), np.float64(0.5)) == key(3, 0.5)


def test_what_no_key_can_be_made_of() -> None:
    with pytest.raises(TypeError, match="a key cannot be made of set"):
        key({1, 2})
