"""A drawn recording, written once."""

from __future__ import annotations

from pathlib import Path

import pytest
from drawn_recording import write_recording

from app.engine.training.recording import Recording, read


@pytest.fixture(scope="session")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a drawn recording; not to be changed."""
    return write_recording(tmp_path_factory.mktemp("recordings") / "nobody")


@pytest.fixture(scope="session")
def recording(drawn: Path) -> Recording:
    return read(drawn)
