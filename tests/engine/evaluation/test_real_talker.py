"""The bars on clips of a real talker, if the recordings and an avatar trained on the others are there."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from app.align.align_clips import align_clips
from app.align.clips import find_clips
from app.align.pocketsphinx import PocketSphinxAligner
from app.engine.evaluation.measure import measure
from app.engine.evaluation.scores import OPEN
from app.engine.evaluation.talker import Talker
from app.engine.pack import load_pack
from app.engine.training.take import Take
from app.engine.training.workspace import Workspace

GRID = Path(os.environ.get("MARY_GRID") or Path(__file__).resolve().parents[4] / "shared" / "data" / "grid_s1")
AVATAR = os.environ.get("MARY_GRID_AVATAR", "")


def test_an_avatar_of_a_real_talker_passes_the_bars(tmp_path: Path) -> None:
    videos = sorted((GRID / "test").glob("*.mpg"))[::8]
    if not videos:
        pytest.skip(f"no recordings of the GRID corpus in {GRID} (MARY_GRID names another folder)")
    if not AVATAR:
        pytest.skip("no avatar of the GRID talker (MARY_GRID_AVATAR names its folder)")
    found = align_clips(find_clips(videos), PocketSphinxAligner)
    takes = [Take(each.clip.name, each.clip.video, each.phones) for each in found.spoken]
    measured = measure(Talker.of(load_pack(Path(AVATAR))), takes, Workspace(tmp_path))
    assert [each.scores.test for each in measured.tests] == [OPEN]
    scores = measured.tests[0].scores
    assert scores.clips == len(videos)
    missed = {bar.figure: bar.value for bar in scores.bars() if not bar.met}
    missed.pop("amplitude of the opening", None)  # four sentences vary too much
    assert not missed
    assert scores.closure is None or scores.closure.recorded == 1
