from pathlib import Path

import pytest
from plugin_package import install

from app.align.recognisers import create, names
from app.errors import MissingExtra, NotFound, RecognitionFailed


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch, "mary.recogniser", "ear", "app.align.mock_recogniser.MockRecogniser")


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
    with pytest.raises(RecognitionFailed, match="stone is no recogniser: Stone lacks warm_up, hear"):
        create("stone")
    with pytest.raises(MissingExtra, match="no_such_library"):
        create("lost")
