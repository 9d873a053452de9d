"""Progress of long work: the share of the whole, the time left, a line a step where there is no terminal."""

from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from app.commands.long_work import LongWork, shown, told

SHARES = {"a": 1.0, "b": 2.0, "c": 1.0}


def test_steps_add_up_to_the_whole() -> None:
    work = LongWork(SHARES)
    for step, share, whole in (("a", 0.5, 0.125), ("a", 1, 0.25), ("b", 0.5, 0.5), ("c", 0, 0.75), ("c", 1, 1.0)):
        work.tell(step, share)
        assert work.done == pytest.approx(whole)


@given(st.lists(st.tuples(st.sampled_from(["a", "b", "c", "unknown"]), st.floats(0, 2)), max_size=30))
def test_the_whole_never_goes_back_and_never_passes_its_end(told_steps: list[tuple[str, float]]) -> None:
    work = LongWork(SHARES)
    before = 0.0
    for step, share in told_steps:
        work.tell(step, share)
        assert before <= work.done <= 1 + 1e-9
        before = work.done


def test_a_skipped_step_counts_as_done() -> None:
    work = LongWork(SHARES)
    work.tell("c", 0)
    assert work.done == pytest.approx(0.75)


def test_the_time_left_is_in_proportion() -> None:
    work = LongWork(SHARES)
    assert work.left(10) is None
    work.tell("b", 0.5)
    assert work.left(30) == pytest.approx(30)


@pytest.mark.parametrize(
    ("seconds", "words"), [(None, ""), (3, "about 5 s left"), (62, "about 60 s left"), (200, "about 3 min left")]
)
def test_a_time_left_is_told_as_people_say_it(seconds: float | None, words: str) -> None:
    assert told(seconds) == words


def test_without_a_terminal_each_step_is_one_line() -> None:
    text = io.StringIO()
    with shown(Console(file=text, width=100), LongWork(SHARES)) as work:
        for step, share in (("a", 0), ("a", 0.5), ("a", 1), ("b", 0), ("b", 1), ("c", 1)):
            work.tell(step, share)
    lines = text.getvalue().splitlines()
    assert [line.split(" (")[0] for line in lines] == ["mary: a", "mary: b", "mary: c"]
    assert "left" in lines[1]


def test_on_a_terminal_there_is_a_bar() -> None:
    text = io.StringIO()
    with shown(Console(file=text, force_terminal=True, width=100), LongWork(SHARES)) as work:
        work.tell("b", 1)
    assert "b" in text.getvalue()
    assert work.done == pytest.approx(0.75)
