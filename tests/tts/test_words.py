import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.tts.words import assign


@pytest.mark.parametrize(
    ("spoken", "expected", "spans"),
    [
        (["a", "b"], [["a"], ["b"]], [(0, 1), (1, 2)]),
        (["x", "y", "b"], [["a"], ["b"]], [(0, 2), (2, 3)]),
        (["ten", "thirty", "P.M."], [["ten", "thirty"], ["pm"]], [(0, 2), (2, 3)]),
        (["three", "million", "dollars", "now"], [["three"], ["million"], ["now"]], [(0, 1), (1, 3), (3, 4)]),
        (["a"], [["a"], [], ["c"]], [(0, 1), (1, 1), (1, 1)]),
        (["new", "a"], [["a"]], [(0, 2)]),
        ([], [["a"]], [(0, 0)]),
        (["a"], [], []),
    ],
)
def test_assign(spoken: list[str], expected: list[list[str]], spans: list[tuple[int, int]]) -> None:
    assert [(span.start, span.stop) for span in assign(spoken, expected)] == spans


@given(
    st.lists(st.sampled_from("abc"), max_size=12),
    st.lists(st.lists(st.sampled_from("abcd"), max_size=3), min_size=1, max_size=8),
)
def test_assigned_spans_are_in_order_and_share_out_everything(spoken: list[str], expected: list[list[str]]) -> None:
    spans = assign(spoken, expected)
    assert len(spans) == len(expected)
    assert [at for span in spans for at in span] == list(range(len(spoken) if any(expected) else 0))
