from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawn_samples import BREAK, SAMPLES, drawn_samples
from tiny_pack import TINY

from app.engine.selection_library import SampleLibrary, load_library, save_library
from app.engine.training.selection_samples import encoded
from app.errors import BadPack

SIZE = (TINY.width, TINY.height)


@pytest.fixture(scope="module")
def library() -> SampleLibrary:
    return drawn_samples()


def test_a_library_is_read_as_it_was_written(library: SampleLibrary, tmp_path: Path) -> None:
    path = tmp_path / "models" / "selection.npz"
    save_library(path, library, encoded(library), modes="abc")
    found = load_library(path, modes="abc", count=5, size=SIZE)
    for name in ("rows", "follows", "lips"):
        assert np.array_equal(getattr(found, name), getattr(library, name))
    assert (len(found), found.window, found.width, found.height) == (SAMPLES, library.window, *SIZE)
    assert not found.follows[BREAK]
    error = found.pictures.astype(float) - library.pictures
    assert np.sqrt((error**2).mean()) < 2  # noise is the worst that a coder can be given


def twice(library: SampleLibrary) -> SampleLibrary:
    rows = library.rows.copy()
    rows[3] = rows[8]
    return replace(library, rows=rows)


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda library: replace(library, rows=library.rows[:, :4]), "rows has shape"),
        (lambda library: replace(library, rows=library.rows * np.nan), "not finite"),
        (twice, "two of the same"),
        (lambda library: replace(library, follows=library.follows[1:]), "follows has shape"),
        (lambda library: replace(library, width=22), "samples are 22x20"),
        (lambda library: replace(library, window=(4, 30, 0, 8)), "window"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(
    library: SampleLibrary, tmp_path: Path, spoil: Callable[[SampleLibrary], SampleLibrary], problem: str
) -> None:
    save_library(tmp_path / "s.npz", spoil(library), encoded(library), modes="abc")
    with pytest.raises(BadPack, match=problem):
        load_library(tmp_path / "s.npz", modes="abc", count=5, size=SIZE)


@pytest.mark.parametrize("clip", ["short", "long", "noise", "other size"])
def test_a_clip_of_something_else_is_refused(library: SampleLibrary, tmp_path: Path, clip: str) -> None:
    fewer = replace(library, pictures=library.pictures[:-1], rows=library.rows[:-1], follows=library.follows[:-1])
    wide = replace(library, width=20, height=24)
    held = {"short": encoded(fewer), "long": encoded(library), "noise": bytes(500), "other size": encoded(wide)}[clip]
    save_library(tmp_path / "s.npz", fewer if clip == "long" else library, held, modes="abc")
    with pytest.raises(BadPack, match="clip"):
        load_library(tmp_path / "s.npz", modes="abc", count=5, size=SIZE)


def test_samples_of_another_pack_are_refused_with_what_to_do(library: SampleLibrary, tmp_path: Path) -> None:
    save_library(tmp_path / "s.npz", library, encoded(library), modes="abc")
    with pytest.raises(BadPack, match="other mouths") as caught:
        load_library(tmp_path / "s.npz", modes="abd", count=5, size=SIZE)
    assert "--models selection" in caught.value.advice
