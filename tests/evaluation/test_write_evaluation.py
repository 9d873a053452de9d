from __future__ import annotations

import json
from pathlib import Path

import pytest
from invented import invented

import app.evaluation.plots
from app.errors import InputError
from app.evaluation.write_evaluation import FIGURES, check_writable, write_figures, write_folder

PLOTS = {
    "open-opening-1.svg", "open-opening-2.svg", "open-psnr.svg", "open-trajectories-1.svg", "open-trajectories-2.svg",
    "open-models.svg", "open-renderers.svg", "training-sizes.svg",
}  # fmt: skip


def test_a_folder_gets_figures_and_plots_and_keeps_what_else_is_in_it(tmp_path: Path) -> None:
    output = tmp_path / "found"
    output.mkdir()
    (output / "notes.txt").write_text("mine")
    write_folder(invented("open"), output)
    assert {path.name for path in output.iterdir()} == PLOTS | {FIGURES, "notes.txt"}
    assert json.loads((output / FIGURES).read_text())["avatar"] == "nobody"
    assert [path.name for path in tmp_path.iterdir()] == ["found"]


def test_plots_are_the_same_bytes_for_the_same_figures(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_folder(invented("open"), tmp_path / name)
    for name in PLOTS:
        one, two = ((tmp_path / folder / name).read_bytes() for folder in ("one", "two"))
        assert one == two
        assert b"<svg" in one
    for name, words in (
        ("open-models.svg", ("AMSE", "ACC", "analysed (ceiling)", "2 sentences")),
        ("open-renderers.svg", ("gaussian, reference", "PSNR", "gradient energy")),
        ("training-sizes.svg", ("minutes of recording", "gaussian")),
    ):
        text = (tmp_path / "one" / name).read_text()
        assert all(word in text for word in words), name
    text = (tmp_path / "one" / "open-trajectories-1.svg").read_text()
    for words in ("clip 1", "recorded", "said by the avatar", ">AA<", "flow mode 2"):
        assert words in text, words


def test_interrupted_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(app.evaluation.plots, "write_plots", stop)
    with pytest.raises(KeyboardInterrupt):
        write_folder(invented("open"), tmp_path / "found")
    assert not list(tmp_path.iterdir())


def test_figures_replace_those_of_before_in_one_step(tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    file.write_text("old")
    write_figures(invented("open"), file)
    assert json.loads(file.read_text())["version"] == 1
    assert list(tmp_path.iterdir()) == [file]


def test_places_that_cannot_be_written_are_found_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    check_writable(tmp_path / "new", tmp_path / "new.json")
    for output, figures, words in (
        (tmp_path / "file", None, "no folder"),
        (tmp_path / "nowhere" / "found", None, "not there"),
        (None, tmp_path / "nowhere" / "figures.json", "not there"),
        (None, tmp_path, "is a folder"),
    ):
        with pytest.raises(InputError, match=words):
            check_writable(output, figures)
