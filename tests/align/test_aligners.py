from __future__ import annotations

import pytest

from app.align.aligners import Aligners
from app.align.pocketsphinx import PocketSphinxAligner
from app.errors import ConfigError, NotFound


def test_each_is_made_once_and_closed() -> None:
    aligners = Aligners()
    assert aligners.get("mock") is aligners.get("mock")
    sphinx = aligners.get("pocketsphinx")
    assert isinstance(sphinx, PocketSphinxAligner)
    sphinx.warm_up()
    assert sphinx.process is not None
    aligners.close()
    assert sphinx.process is None
    aligners.close()


def test_what_is_unknown_or_has_unknown_options_is_refused() -> None:
    with pytest.raises(NotFound, match="no aligner 'ear'"):
        Aligners().get("ear")
    with pytest.raises(ConfigError, match=r"align\.aligners\.mock"):
        Aligners({"mock": {"loud": True}}).get("mock")
