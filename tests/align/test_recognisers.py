from pathlib import Path

import pytest

from app.align.recognisers import create, names
from app.errors import MissingExtra, NotFound, RecognitionFailed

PLUGIN = """
from app.align.mock_recogniser import MockRecogniser

class Ear(MockRecogniser):
    name = "ear"

class Stone:
    pass
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package as a third party would install it."""
    (tmp_path / "hearing_plugin.py").write_text(PLUGIN)
    info = tmp_path / "hearing-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: hearing\nVersion: 1.0\n")
    points = ["ear = hearing_plugin:Ear", "stone = hearing_plugin:Stone", "lost = no_such_library:Recogniser"]
    (info / "entry_points.txt").write_text("\n".join(["[mary.recogniser]", *points, ""]))
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.parametrize("name", ["hama", "mock"])
def test_ours_are_made_by_name(name: str) -> None:
    assert create(name).name == name
    assert name in names()


def test_an_unknown_one_is_not_found_and_the_known_ones_are_listed() -> None:
    with pytest.raises(NotFound) as error:
        create("owl")
    assert error.value.field == "align.recogniser"
    assert "hama" in error.value.advice


@pytest.mark.usefixtures("plugin")
def test_other_packages_bring_theirs() -> None:
    assert create("ear").name == "ear"
    with pytest.raises(RecognitionFailed, match="stone is no recogniser"):
        create("stone")
    with pytest.raises(MissingExtra, match="no_such_library"):
        create("lost")
