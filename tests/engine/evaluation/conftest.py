"""Mary measured once, on two pieces of her recording: one that she is said to have learnt from, one not."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
from recorded import cut

from app.align.align_clips import align_clips
from app.align.clips import find_clips
from app.align.mock import MockAligner
from app.engine.avatar import Avatar
from app.engine.evaluation.measure import Measured, measure
from app.engine.evaluation.talker import Talker
from app.engine.training.take import Take
from app.engine.training.workspace import Workspace


@pytest.fixture(scope="session")
def talker(mary: Avatar) -> Talker:
    return Talker.of(mary.pack)


@pytest.fixture(scope="session")
def takes(tmp_path_factory: pytest.TempPathFactory) -> list[Take]:
    folder = tmp_path_factory.mktemp("clips")
    cut(folder, "known", 1.3)
    cut(folder, "new", 1.8)
    found = align_clips(find_clips([folder]), MockAligner)
    return [Take(each.clip.name, each.clip.video, each.phones) for each in found.spoken]


@pytest.fixture(scope="session")
def measured(talker: Talker, takes: list[Take], tmp_path_factory: pytest.TempPathFactory) -> Measured:
    known = frozenset({hashlib.sha256(takes[0].video.read_bytes()).hexdigest()})
    folder: Path = tmp_path_factory.mktemp("workspace")
    return measure(
        replace(talker, trained_on=known), takes, Workspace(folder), models={"shut": shut(talker)}, gains=[1.2]
    )  # fmt: skip


def shut(talker: Talker):
    """Another trajectory model: one that keeps the mouth shut."""
    return lambda _, frames: talker.trajectory.rest[None].repeat(frames, 0)
