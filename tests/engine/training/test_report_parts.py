from __future__ import annotations

import numpy as np
import pytest

from app.engine.states import VISEMES
from app.engine.training.report.fallbacks import count_states
from app.engine.training.report.likeness import colour_wheel, flow_colours, shown_difference
from app.engine.training.report.markup import Markup, element, image, table, text
from app.engine.training.report.plots import histograms, trajectories
from app.engine.training.report.rejections import group, spans
from app.engine.training.report.steadiness import shifts
from app.engine.training.take import Refusal
from app.speech import Phone


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [([], ""), ([3], "3"), ([3, 4], "3 to 4"), ([0, 2, 3, 4, 9], "0, 2 to 4, 9")],
)
def test_spans(numbers: list[int], expected: str) -> None:
    assert spans(numbers) == expected


def test_reasons_that_differ_in_numbers_are_one() -> None:
    refused = [
        Refusal("a", 3, "moved 4 pixels of 100"), Refusal("a", 1, "moved 12 pixels of 100"),
        Refusal("b", None, "2 faces"), Refusal("b", 7, "grey"),
    ]  # fmt: skip
    found = group(refused, [("c", "3 faces"), ("d", "no sound")])
    assert [(each.reason, each.clips, each.frames) for each in found] == [
        ("2 to 3 faces", ("c", "b"), ()),
        ("no sound", ("d",), ()),
        ("moved 4 to 12 pixels of 100", (), (("a", (1, 3)),)),
        ("grey", (), (("b", (7,)),)),
    ]
    assert found[2].pictures == 2


def test_everything_is_escaped_once_unless_it_is_markup() -> None:
    assert text("<a & b>") == "&lt;a &amp; b&gt;"
    assert text(text("<a>")) == "&lt;a&gt;"
    assert element("p", "<", Markup("<br>"), kind='"') == '<p class="&quot;">&lt;<br></p>'
    assert 'alt="&quot;x&quot;"' in image("data:,", '"x"')
    assert "<td>&lt;i&gt;</td>" in table(["<h>"], [["<i>"]])


def test_states_are_counted_by_kind() -> None:
    counts = count_states(["AA.0", "AA.1", "AA.0|P", "SIL", "SIL.after0|P", "SIL.after0"])
    assert (counts.halves, counts.contexts, counts.silences) == (2, 1, 3)
    assert counts.possible == 39 * 2 * len(VISEMES)


def test_shifts_are_found_within_a_tenth_of_a_pixel() -> None:
    random = np.random.default_rng(0)
    waves = random.normal(0, 1, (4, 3)) * [0.25, 0.25, 3]
    y, x = np.mgrid[:40, :50].astype(np.float64)
    moved = random.uniform(-1.5, 1.5, (30, 2))
    windows = [
        sum(30 * np.sin(a * (x - dx) + b * (y - dy) + c) for a, b, c in waves).astype(np.float32) for dy, dx in moved
    ]
    expected = np.linalg.norm(moved - moved.mean(0), axis=1)
    np.testing.assert_allclose(shifts(windows, 6), expected, atol=0.1)


def test_colours_say_where_a_point_goes() -> None:
    flow = np.array([[[0, 0], [2, 0], [-2, 0], [9, 0], [1, 0]]], np.float32)
    colours = flow_colours(flow, 2.0)[0]
    assert colours.tolist() == [[255, 255, 255], [255, 0, 0], [0, 255, 255], [255, 0, 0], [255, 128, 128]]
    wheel = colour_wheel(41)
    assert wheel[20, 40].tolist() == [255, 0, 0]
    assert wheel[20, 20].tolist() == wheel[0, 0].tolist() == [255, 255, 255]


def test_no_difference_is_grey() -> None:
    shown = shown_difference(np.array([[0, 10, -100]], np.float32))
    assert shown[0, :, 0].tolist() == [128, 168, 0]


def test_plots_are_pictures_and_leave_pyplot_alone() -> None:
    import sys

    rows = [("flow 1", np.array([0, np.nan, 1], np.float32), np.zeros(3, np.float32))]
    for png in (
        histograms([("a", np.arange(9.0)), ("b", np.zeros(3))], "px", most=5.0),
        trajectories(rows, [Phone("SIL", 0, 0.04), Phone("AA", 0.04, 0.12)]),
    ):
        assert png.startswith(b"\x89PNG")
    assert "matplotlib.pyplot" not in sys.modules
