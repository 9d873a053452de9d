import pytest

from app.align.textgrid import Interval, Tier, parse
from app.errors import InputError

LONG = """File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0
xmax = 1.25
tiers? <exists>
size = 3
item []:
    item [1]:
        class = "IntervalTier"
        name = "words"
        xmin = 0
        xmax = 1.25
        intervals: size = 2
        intervals [1]:
            xmin = 0
            xmax = 0.5
            text = ""
        intervals [2]:
            xmin = 0.5
            xmax = 1.25
            text = "say ""hi"" 2 me"
    item [2]:
        class = "TextTier"
        name = "clicks"
        xmin = 0
        xmax = 1.25
        points: size = 1
        points [1]:
            number = 0.3
            mark = "click"
    item [3]:
        class = "IntervalTier"
        name = "empty"
        xmin = 0
        xmax = 1.25
        intervals: size = 0
"""
SHORT = """"ooTextFile"
"TextGrid"
0
1.25 ! a comment with "quotes" and 7 numbers
<exists>
2
"IntervalTier"
"words"
0
1.25
2
0
0.5
""
0.5
1.25e0
"say ""hi"" 2 me"
"IntervalTier" "empty" 0 1.25 0
"""
TIERS = (Tier("words", (Interval(0, 0.5, ""), Interval(0.5, 1.25, 'say "hi" 2 me'))), Tier("empty", ()))


@pytest.mark.parametrize("text", [LONG, SHORT])
def test_both_forms(text: str) -> None:
    assert parse(text) == TIERS


def test_no_tiers() -> None:
    assert parse('File type = "ooTextFile"\nObject class = "TextGrid"\n0\n1\n<absent>\n') == ()


@pytest.mark.parametrize("length", range(0, len(LONG) - 70, 40))
def test_cut_off_files_are_refused(length: int) -> None:
    with pytest.raises(InputError, match="TextGrid"):
        parse(LONG[:length])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"TextGrid"', '"Sound"', "does not begin"),
        ('"TextTier"', '"OtherTier"', "unknown kind of tier 'OtherTier'"),
        ("size = 3", "size = 1e9", "no number of tiers"),
        ("size = 2", "size = 2.5", "no number of tiers or intervals"),
        ("xmin = 0.5", "xmin = 0.4", "'words' go backwards at 0.4"),
        ("xmax = 0.5", 'xmax = "0.5"', "number was expected"),
    ],
)
def test_broken_files_say_what_is_broken(old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse(LONG.replace(old, new, 1))
