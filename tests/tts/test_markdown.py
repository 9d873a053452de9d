import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.tts.markdown import strip_markdown


@pytest.mark.parametrize(
    ("written", "plain"),
    [
        ("# Title #5", "Title #5"),
        ("**bold**, *it*, ***both***, __x__, _y_", "bold, it, both, x, y"),
        ("**bold *and* more**", "bold and more"),
        ("`code`, ``more``, ~~old~~", "code, more, old"),
        ("snake_case, 2*3, 2 * 3, don`t", "snake_case, 2*3, 2 * 3, don`t"),
        ("- one\n* two\n+ three\n  - [x] four", "one\n\ntwo\n\nthree\n\nfour"),
        ("Buy:\n- Eggs\n- **milk**", "Buy:\nEggs\n\nmilk"),
        ("# title\nsome text", "title\n\nsome text"),
        ("> said\n>> twice", "said\ntwice"),
        ("1. first", "1. first"),
        ("[text](http://a.b) ![pic](p.png \"t\") [ref][1]", "text pic ref"),
        ("<https://a.b>", "https://a.b"),
        ("```py\nx = 1\n```", "\nx = 1\n"),
        ("a\n---\nb", "a\n\nb"),
        ("Title\n=====", "Title\n"),
        ("| a | b |\n|---|:-:|\n| 1 |  |", "a, b\n1"),
        ("Who:\n| a | B |\n|---|---|\n| `c` | d |\n| E | f |", "Who:\n\na, B\n\nc, d\nE, f"),
        (r"\*not\* \# this", "*not* # this"),
        ("-5 degrees", "-5 degrees"),
        ("", ""),
    ],
)  # fmt: skip
def test_strip_markdown(written: str, plain: str) -> None:
    assert strip_markdown(written) == plain


@given(st.lists(st.sampled_from([*"ab1 *_`#>~|-=+\n.\\!<", "**", "```", "- "]), max_size=80).map("".join))
def test_no_letter_is_lost(text: str) -> None:
    kept = [line for line in text.split("\n") if not line.lstrip(" \t").startswith(("```", "~~~"))]
    assert [x for x in strip_markdown(text) if x.isalnum()] == [x for x in "\n".join(kept) if x.isalnum()]


@pytest.mark.parametrize(
    "bit", ["*", "_", "`", "a*", "*a ", "[", "[a](", "![", "|", "| ", "- ", "> ", "~", "\\", "[a]["]
)
def test_long_messes_take_no_time(bit: str) -> None:
    strip_markdown((bit * 50_000)[:50_000])
    strip_markdown("x" + (bit * 50_000)[:50_000] + "x")
