"""A drawn recording, made and learnt once."""

from __future__ import annotations

from pathlib import Path

import pytest
from drawn_recording import drawn_corpus

from app.engine.threads import one_thread_a_call
from app.engine.training.appearance import Appearance, learn_appearance
from app.engine.training.corpus import Corpus
from app.engine.training.workspace import Workspace


@pytest.fixture(scope="session")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Corpus:
    """Not to be changed."""
    return drawn_corpus(tmp_path_factory.mktemp("drawn") / "corpus")


@pytest.fixture(scope="session")
def learning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The workspace that `appearance` was learnt in."""
    return tmp_path_factory.mktemp("learning")


@pytest.fixture(scope="session")
def appearance(corpus: Corpus, learning: Path) -> Appearance:
    """What was learnt of the drawn recording."""
    one_thread_a_call()
    return learn_appearance(corpus, Workspace(learning), seed=0, progress=lambda *_: None, workers=1)
