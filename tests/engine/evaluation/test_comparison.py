from __future__ import annotations

import pytest

from app.engine.evaluation.comparison import ANALYSED, REST, Comparison
from app.engine.evaluation.measure import Measured
from app.engine.evaluation.scores import CLOSED, OPEN


@pytest.fixture(params=[0, 1], ids=[OPEN, CLOSED])
def comparison(measured: Measured, request: pytest.FixtureRequest) -> Comparison:
    return measured.comparisons[request.param]


def test_all_models_are_scored_in_both_tests(measured: Measured) -> None:
    assert [each.test for each in measured.comparisons] == [OPEN, CLOSED]
    for each in measured.comparisons:
        assert [row.model for row in each.rows] == [REST, "gaussian", "phone-mean", ANALYSED]
        assert (each.sentences, each.pictured) == (1, 1)
        assert [[its.renderer for its in row.rendered] for row in each.rows] == [["fast"]] * 4


def test_a_mouth_that_moves_is_between_rest_and_the_ceiling(comparison: Comparison) -> None:
    rest, gaussian, shut, analysed = (row.scores for row in comparison.rows)
    assert analysed.trajectory.error_weighted < 0.5 * gaussian.trajectory.error_weighted
    assert rest.trajectory.error < 10
    assert gaussian.trajectory.error_weighted < 0.5 * rest.trajectory.error_weighted
    assert shut.trajectory == rest.trajectory
    assert analysed.opening is not None
    assert analysed.opening.correlation == pytest.approx(1)
    assert gaussian.milliseconds > 0
    assert rest.milliseconds == analysed.milliseconds == 0


def test_pictures_are_those_of_the_measurement(measured: Measured, comparison: Comparison) -> None:
    (scores,) = (each.scores for each in measured.tests if each.scores.test == comparison.test)
    for row, name in ((0, "neutral"), (1, "predicted"), (3, "analysed")):
        (its,) = comparison.rows[row].rendered
        expected = scores.speech[name]
        assert its.pictures is not None
        assert expected is not None
        assert its.pictures.psnr == pytest.approx(expected.psnr, abs=0.05)
        assert its.pictures.ssim == pytest.approx(expected.ssim, abs=0.002)
        assert its.squares == pytest.approx(comparison.rows[row].scores.squares, rel=0.02)
    still, moving = comparison.rows[0].rendered[0], comparison.rows[1].rendered[0]
    assert still.jumps < 0.02 < moving.jumps


def test_models_are_trained_anew_on_what_was_learnt_and_scored_on_what_was_not(measured: Measured) -> None:
    points = {point.model: point for point in measured.sizes}
    assert list(points) == ["gaussian", "phone-mean"]
    for point in points.values():
        assert point.sentences == 1
        assert point.minutes == pytest.approx(1.3 / 60, abs=0.1 / 60)
        assert point.scores is not None
        assert point.scores.trajectory.sentences == 1
    rest = measured.comparisons[0].rows[0].scores
    assert points["gaussian"].scores.squares < rest.squares  # type: ignore[union-attr]


def test_few_clips_give_the_space_themselves(measured: Measured) -> None:
    assert not measured.own_space
