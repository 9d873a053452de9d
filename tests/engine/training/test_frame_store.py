from __future__ import annotations

import errno
import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.engine.training.frame_store import FrameStore


def rows(count: int, shape: tuple[int, ...], dtype: str, seed: int = 0) -> NDArray[Any]:
    return np.random.default_rng(seed).integers(0, 200, (count, *shape)).astype(dtype)


@given(
    count=st.integers(1, 30), shape=st.lists(st.integers(1, 5), max_size=3).map(tuple),
    dtype=st.sampled_from(["uint8", "float16", "float32", "int64"]), data=st.data(),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, count: int, shape: tuple[int, ...], dtype: str, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("store") / "frames.rows"
    store = FrameStore.create(path, count, shape, dtype)
    assert len(store) == store.rows == count
    assert path.stat().st_size == count * store.bytes_a_row
    np.testing.assert_array_equal(store.read(0, count), np.zeros((count, *shape)))
    whole = rows(count, shape, dtype)
    cuts = sorted({0, count, *data.draw(st.lists(st.integers(0, count), max_size=4))})
    for start, stop in reversed(list(pairwise(cuts))):
        store.write(start, whole[start:stop])
    assert path.stat().st_size == count * store.bytes_a_row
    start, stop = data.draw(st.integers(0, count)), data.draw(st.integers(0, count + 5))
    found = store.read(start, stop)
    assert found.dtype == whole.dtype
    np.testing.assert_array_equal(found, whole[start:stop])
    numbers = data.draw(st.lists(st.integers(0, count - 1), max_size=12))
    np.testing.assert_array_equal(store.take(numbers), whole[numbers])
    again = FrameStore(path, count, shape, np.dtype(dtype))
    np.testing.assert_array_equal(again.read(0, count), whole)


@given(
    numbers=st.sets(st.integers(0, 399), max_size=200).map(sorted), size=st.integers(1, 50),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_blocks_are_the_rows_in_order(tmp_path_factory: pytest.TempPathFactory, numbers: list[int], size: int) -> None:
    whole = rows(400, (3,), "uint8")
    store = FrameStore.create(tmp_path_factory.mktemp("store") / "frames.rows", 400, (3,), np.uint8)
    store.write(0, whole)
    blocks = list(store.blocks(np.array(numbers, np.int64), size))
    assert all(len(block) == size for block in blocks[:-1])
    joined = np.concatenate(blocks) if blocks else np.empty((0, 3), np.uint8)
    np.testing.assert_array_equal(joined, whole[numbers])


def test_rows_of_another_type_are_converted(tmp_path: Path) -> None:
    store = FrameStore.create(tmp_path / "frames.rows", 2, (2,), np.float16)
    store.write(0, np.array([[1.0, 2.5], [3.0, 4.0]]))
    np.testing.assert_array_equal(store.read(0, 2), np.array([[1, 2.5], [3, 4]], np.float16))


def test_rows_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    store = FrameStore.create(tmp_path / "frames.rows", 4, (3,), np.uint8)
    for start, wrong in ((3, (2, 3)), (-1, (1, 3)), (0, (5, 3)), (0, (1, 4)), (0, (3,))):
        with pytest.raises(ValueError, match="do not fit"):
            store.write(start, np.ones(wrong, np.uint8))
    assert store.read(0, 4).sum() == 0
    assert store.path.stat().st_size == 12


def test_rows_that_are_not_there(tmp_path: Path) -> None:
    store = FrameStore.create(tmp_path / "frames.rows", 4, (3,), np.uint8)
    assert store.read(2, 2).shape == (0, 3)
    assert store.read(3, 100).shape == (1, 3)
    for number in (4, -1):
        with pytest.raises(IndexError):
            store.take([number])
    with store.path.open("r+b") as file:
        file.truncate(7)
    with pytest.raises(OSError, match="cut off"):
        store.read(0, 4)
    with pytest.raises(OSError, match="cut off"):
        store.take([3])


def test_several_may_write_at_once(tmp_path: Path) -> None:
    store = FrameStore.create(tmp_path / "frames.rows", 256, (100,), np.uint8)
    whole = rows(256, (100,), "uint8")
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda start: store.write(start, whole[start : start + 4]), range(0, 256, 4)))
    np.testing.assert_array_equal(store.read(0, 256), whole)


def test_a_full_disk_is_noticed_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match="No space left"):
        FrameStore.create(tmp_path / "frames.rows", 10, (3,), np.uint8)
    FrameStore.create(tmp_path / "frames.rows", 0, (3,), np.uint8)  # nothing to claim
