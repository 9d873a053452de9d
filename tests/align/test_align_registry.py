from pathlib import Path

import numpy as np
import pytest

from app.align.aligner import Aligner
from app.align.registry import create, names
from app.errors import AlignmentFailed, MissingExtra, NotFound

PLUGIN = """
from app.align.mock import MockAligner

class Ear(MockAligner):
    name = "ear"

class Stone:
    pass
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package as a third party would install it."""
    (tmp_path / "ear_plugin.py").write_text(PLUGIN)
    info = tmp_path / "ear-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: ear\nVersion: 1.0\n")
    points = ["ear = ear_plugin:Ear", "stone = ear_plugin:Stone", "lost = no_such_library:Aligner"]
    (info / "entry_points.txt").write_text("\n".join(["[mary.align]", *points, ""]))
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.parametrize("name", ["pocketsphinx", "mock"])
def test_ours(name: str) -> None:
    aligner = create(name)
    assert isinstance(aligner, Aligner)
    assert aligner.name == name


def test_unknown_names_the_known() -> None:
    with pytest.raises(NotFound, match="nobody") as caught:
        create("nobody")
    assert "pocketsphinx, mock" in caught.value.advice


@pytest.mark.usefixtures("plugin")
def test_entry_points() -> None:
    assert names() == ("pocketsphinx", "mock", "ear", "lost", "stone")
    assert create("ear").align(np.ones(16_000, np.float32), 16_000, "hello").words[0].text == "hello"


@pytest.mark.usefixtures("plugin")
def test_bad_entry_points() -> None:
    with pytest.raises(AlignmentFailed, match="Stone"):
        create("stone")
    with pytest.raises(MissingExtra, match="no_such_library"):
        create("lost")
