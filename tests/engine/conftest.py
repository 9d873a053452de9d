"""The shipped avatar, loaded once, and a tiny one that is quick to write, to load and to damage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawn_samples import add_samples
from numpy.typing import NDArray
from tiny_pack import tiny_background, tiny_model, tiny_modes, write_tiny

from app.align.transcript import read_transcript
from app.engine.avatar import Avatar, load_avatar
from app.engine.background import Background
from app.engine.mmm import MorphableModel
from app.engine.modes import Modes
from app.speech import Phone

MARY = Path(__file__).resolve().parents[2] / "avatars" / "mary"

SENTENCE_FRAMES = 72
"""The first sentence of Mary's recording."""


@pytest.fixture(scope="session")
def mary() -> Avatar:
    return load_avatar(MARY)


@pytest.fixture(scope="session")
def phones() -> tuple[Phone, ...]:
    """What Mary says in her recording."""
    return read_transcript(MARY / "recording" / "recording.TextGrid").alignment(28.48).phones


@pytest.fixture(scope="session")
def spoken(mary: Avatar, phones: tuple[Phone, ...]) -> NDArray[np.float32]:
    """(T, K) mouths of the first sentence of the recording."""
    return mary.trajectory(phones, SENTENCE_FRAMES)


@pytest.fixture(scope="session")
def literal_mary(mary: Avatar) -> Avatar:
    """Mary drawn by the reference renderer; three frames of the loop are enough, each costs N warps to prepare."""
    background = mary.pack.background
    kept = [0, 40, 90, background.frames]
    shorter = replace(background, pictures=background.pictures[kept], pose=background.pose[kept])
    return Avatar(replace(mary.pack, background=shorter), "reference")


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a tiny pack; not to be changed."""
    return write_tiny(tmp_path_factory.mktemp("packs") / "tiny")


@pytest.fixture(scope="session")
def sampled(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with samples for the selection renderer; not to be changed."""
    folder = tmp_path_factory.mktemp("sampled") / "tiny"
    add_samples(tiny, folder)
    return folder


@pytest.fixture
def modes() -> Modes:
    return tiny_modes()


@pytest.fixture
def model() -> MorphableModel:
    return tiny_model()


@pytest.fixture
def background() -> Background:
    return tiny_background()
