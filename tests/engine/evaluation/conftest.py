"""Mary measured once, on two pieces of her recording: one that she is said to have learnt from, one not."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from recorded import cut

from app.align.align_clips import align_clips
from app.align.clips import find_clips
from app.align.mock import MockAligner
from app.engine.avatar import Avatar
from app.engine.evaluation.comparison import Against
from app.engine.evaluation.measure import Measured, measure
from app.engine.evaluation.pictured import Drawer
from app.engine.evaluation.talker import Talker
from app.engine.models.model import Input
from app.engine.models.sound import Sound
from app.engine.training.take import Take
from app.engine.training.workspace import Workspace
from app.speech import Phone


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
def measured(mary: Avatar, talker: Talker, takes: list[Take], tmp_path_factory: pytest.TempPathFactory) -> Measured:
    against = Against(
        {"gaussian": mary.pack.trajectory, "phone-mean": Shut(talker)}, (Drawer.of(mary.pack, "fast"),), sounds, (1,)
    )
    known = frozenset({hashlib.sha256(takes[0].video.read_bytes()).hexdigest()})
    folder: Path = tmp_path_factory.mktemp("workspace")
    return measure(
        replace(talker, trained_on=known), takes, Workspace(folder), models={"shut": Shut(talker).predict},
        gains=[1.2], against=against,
    )  # fmt: skip


class Shut:
    """Another trajectory model: one that keeps the mouth shut."""

    name = "phone-mean"  # under which it can be trained anew
    inputs: frozenset[Input] = frozenset({"phones"})

    def __init__(self, talker: Talker) -> None:
        self.rest = talker.trajectory.rest

    def predict(
        self, phones: Sequence[Phone], frames: int, *, before: object = None, sound: Sound | None = None
    ) -> NDArray[np.float32]:
        del phones, before, sound
        return self.rest[None].repeat(frames, 0)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        return {}


def sounds(take: Take) -> Sound:
    """Each take has another number of samples."""
    return Sound(np.zeros(len(take.name), np.float32), 16_000)
