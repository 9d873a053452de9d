from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from app.engine.evaluation.measure import Measured, measure
from app.engine.evaluation.scores import CLOSED, OPEN, Bar
from app.engine.evaluation.talker import Talker
from app.engine.training.take import Take
from app.engine.training.workspace import Workspace
from app.errors import InputError
from app.speech import Phone

GRID = Path(os.environ.get("MARY_GRID") or Path(__file__).resolve().parents[4] / "shared" / "data" / "grid_s1")


def test_known_clips_are_the_closed_test_and_others_the_open_one(measured: Measured) -> None:
    assert [each.scores.test for each in measured.tests] == [OPEN, CLOSED]
    assert [[one.sentence.name for one in each.examples] for each in measured.tests] == [["new"], ["known"]]
    assert not measured.refused


def test_mary_says_what_she_was_recorded_saying(measured: Measured) -> None:
    for test in measured.tests:
        scores = test.scores
        by = {(row.model, row.space): row.scores for row in scores.trajectories}
        for space in ("all modes", "leading modes"):
            assert by["avatar", space].error_weighted < 0.5 * by["mean", space].error_weighted
            assert by["avatar", space].correlation_weighted > 0.8
            assert by["rest", space].correlation == by["mean", space].correlation == 0
            assert by["mean", space].amplitude == pytest.approx(0, abs=1e-9)
            assert by["shut", space] == by["rest", space]  # other models are scored like the avatar's own
        said = scores.speech
        assert said["neutral"].psnr < said["predicted"].psnr - 3 < said["analysed"].psnr - 3
        assert said["predicted"].pictures == scores.speech_frames
        assert scores.opening.correlation > 0.9
        assert abs(scores.opening.lag) <= 1
        assert scores.nose.p95 < 2


def test_reconstruction_keeps_its_order(measured: Measured) -> None:
    again = measured.tests[0].scores.reconstruction
    assert again.sampled == again.available == measured.tests[0].scores.frames
    assert again.speech["serving"].psnr > again.speech["literal"].psnr > 30
    assert again.fast_minus_literal == pytest.approx(again.speech["fast"].psnr - again.speech["literal"].psnr)
    assert again.fast_minus_literal > -0.5
    assert again.fast_against_literal.psnr > 40


def test_a_gain_enlarges_the_opening(measured: Measured) -> None:
    plain, louder = measured.tests[0].scores.gains
    assert (plain.gain, louder.gain) == (1, 1.2)
    assert louder.amplitude == pytest.approx(1.2 * plain.amplitude, rel=0.1)
    assert plain.psnr == measured.tests[0].scores.speech["predicted"].psnr


def test_sentences_can_be_plotted(measured: Measured) -> None:
    example = measured.tests[0].examples[0]
    count = len(example.sentence.numbers)
    assert example.sentence.true.shape == example.sentence.predicted.shape == (count, len(measured.scale))
    assert example.drawn.scores.shape == (count, 3, 2)
    assert np.isfinite(example.drawn.shown).all()
    assert np.isfinite(example.drawn.recorded).all()


def test_bars_are_met_between_their_limits() -> None:
    assert Bar("a", 1.0, least=1, most=1).met
    assert not Bar("a", 0.9, least=1).met
    assert not Bar("a", 1.1, most=1).met
    assert not Bar("a", None).met


def test_silence_cannot_be_measured(talker: Talker, takes: list[Take], tmp_path: Path) -> None:
    silent = Take("known", takes[0].video, (Phone("SIL", 0.0, 1.5),))
    with pytest.raises(InputError, match="no clip to measure mary on"):
        measure(talker, [silent], Workspace(tmp_path))


def test_another_face_is_refused(talker: Talker, tmp_path: Path) -> None:
    videos = sorted((GRID / "test").glob("*.mpg"))[:1]
    if not videos:
        pytest.skip(f"no recordings of the GRID corpus in {GRID} (MARY_GRID names another folder)")
    take = Take("stranger", videos[0], (Phone("SIL", 0.0, 1.0), Phone("AA", 1.0, 2.0), Phone("SIL", 2.0, 3.0)))
    with pytest.raises(InputError, match="the face is not that of mary's talker"):
        measure(talker, [take], Workspace(tmp_path))
