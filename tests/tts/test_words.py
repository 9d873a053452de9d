import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.speech import Word
from app.tts.words import as_written, assign, parts


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


def spoken(*words: str) -> list[Word]:
    """Words of a second each."""
    return [Word(word, float(at), float(at + 1)) for at, word in enumerate(words)]


@pytest.mark.parametrize(
    ("heard", "readings", "times"),
    [
        (("It", "costs", "three", "dollars."), ("It", "costs", "three dollars."), [(0, 1), (1, 2), (2, 4)]),
        (("It", "three", "dollars"), ("It", "costs", "three dollars"), [(0, 1), None, (1, 3)]),  # dropped
        (("thankyou", "now"), ("thank", "you", "now"), [(0, 0.625), (0.625, 1), (1, 2)]),  # joined
        (("thank you", "now"), ("thank", "you", "now"), [(0, 0.625), (0.625, 1), (1, 2)]),
        (("to", "day", "now"), ("today", "now"), [(0, 2), (2, 3)]),  # divided
        (("five", "um", "now"), ("five", "now"), [(0, 2), (2, 3)]),  # added
        (("5", "€"), ("five euros",), [(0, 1)]),  # written otherwise
        (("one",), ("one", "—", "..."), [(0, 1), None, None]),
        ((), ("one",), [None]),
        (("one",), (), []),
    ],
)
def test_as_written(heard: tuple[str, ...], readings: tuple[str, ...], times: list[tuple[float, float] | None]) -> None:
    found = as_written(spoken(*heard), readings)
    assert [word and (word.start, word.end) for word in found] == times


@given(
    st.lists(st.sampled_from(["a", "bb", "a bb", "ccc,", "—", "é", ""]), max_size=12),
    st.lists(st.sampled_from(["a", "bb", "abb", "ccc", "a bb", "—"]), max_size=12),
)
def test_written_words_stay_in_order_and_within_the_sound(readings: list[str], heard: list[str]) -> None:
    found = [word for word in as_written(spoken(*heard), readings) if word is not None]
    edge = 0.0
    for word in found:
        assert edge - 1e-9 <= word.start <= word.end
        edge = word.end
    assert edge <= len(heard)


def test_parts() -> None:
    assert parts("“Wait!”") == ("“", "Wait", "!”")
    assert parts("U.N.'s,") == ("", "U.N.'s", ",")
    assert parts("—") == ("—", "", "")
    assert parts("") == ("", "", "")
