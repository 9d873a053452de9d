from pathlib import Path

import numpy as np
import pytest
from plugin_package import install

from app.align.aligner import Aligner
from app.align.registry import create, names
from app.errors import AlignmentFailed, MissingExtra, NotFound


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch, "mary.align", "ear", "app.align.mock.MockAligner")


@pytest.mark.parametrize("name", ["pocketsphinx", "xmlrpc", "mock"])
def test_ours(name: str) -> None:
    aligner = create(name)
    assert isinstance(aligner, Aligner)
    assert aligner.name == name


def test_unknown_names_the_known() -> None:
    with pytest.raises(NotFound, match="nobody") as caught:
        create("nobody")
    assert "pocketsphinx, textgrid, xmlrpc, mock" in caught.value.advice


@pytest.mark.usefixtures("plugin")
def test_entry_points() -> None:
    assert names() == ("pocketsphinx", "textgrid", "xmlrpc", "mock", "ear", "lost", "stone")
    assert create("ear").align(np.ones(16_000, np.float32), 16_000, "hello").words[0].text == "hello"


@pytest.mark.usefixtures("plugin")
def test_bad_entry_points() -> None:
    with pytest.raises(AlignmentFailed, match="Stone lacks align"):
        create("stone")
    with pytest.raises(MissingExtra, match="no_such_library"):
        create("lost")
