import pytest

from app.tts.reading.say_as import KINDS, say_as


@pytest.mark.parametrize(
    ("text", "kind", "form", "said"),
    [
        ("ABC", "characters", "", "A.B.C"),
        ("a1-b", "spell-out", "", "A one dash B"),
        ("12", "cardinal", "", "twelve"),
        ("-1,000.5", "number", "", "minus one thousand point five"),
        ("XIV", "cardinal", "", "fourteen"),
        ("3", "ordinal", "", "third"),
        ("21st", "ordinal", "", "twenty first"),
        ("VIII", "ordinal", "", "eighth"),
        ("1234", "digits", "", "one two three four"),
        ("5/1/2026", "date", "dmy", "January fifth, twenty twenty six"),
        ("5/1/2026", "date", "mdy", "May first, twenty twenty six"),
        ("20260105", "date", "ymd", "January fifth, twenty twenty six"),
        ("Jan 2026", "date", "my", "January twenty twenty six"),
        ("5.1", "date", "dm", "January fifth"),
        ("2026", "date", "y", "twenty twenty six"),
        ("2026-01-05", "date", "", "January fifth, twenty twenty six"),
        ("10:30 pm", "time", "", "ten thirty P.M"),
        ("+1 555 0100", "telephone", "", "plus one, five five five, zero one zero zero"),
        ("3/4", "fraction", "", "three quarters"),
        ("2 1/2", "fraction", "", "two and a half"),
        ("3/20", "fraction", "", "three twentieths"),
        ("5 km", "unit", "", "five kilometers"),
        ("20 °C", "unit", "", "twenty degrees Celsius"),
        ("x", "cardinal", "", ""),
        ("x", "ordinal", "", ""),
        ("x", "digits", "", ""),
        ("99/99/99", "date", "mdy", ""),
        ("5/1", "date", "dmy", ""),
        ("x", "date", "nonsense", ""),
        ("x", "time", "", ""),
        ("x", "telephone", "", ""),
        ("1/0", "fraction", "", ""),
        ("x", "unit", "", ""),
    ],
)
def test_say_as(text: str, kind: str, form: str, said: str) -> None:
    assert say_as(text, kind, form) == said


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("text", ["", " ", "½", "٣", "你", "²", "9" * 200, "-" * 200, "1/" * 100, "a" * 200, "\u0301"])
def test_any_text_is_said_or_not(kind: str, text: str) -> None:
    assert not any(map(str.isdigit, say_as(text, kind)))
