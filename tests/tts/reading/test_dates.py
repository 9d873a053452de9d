import pytest

from app.tts.reading.dates import date, day, decade, half_of_day, is_year, telephone, time


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("2026-11-24", "November twenty fourth, twenty twenty six"),
        ("11/24/2026", "November twenty fourth, twenty twenty six"),
        ("24/11/2026", "November twenty fourth, twenty twenty six"),
        ("24.11.2026", "November twenty fourth, twenty twenty six"),
        ("1/2/99", "January second, nineteen ninety nine"),
        ("2026-11-24T14:05:00Z", "November twenty fourth, twenty twenty six, fourteen oh five and zero seconds"),
        ("2026/11/24", "November twenty fourth, twenty twenty six"),
        ("24-11-2026", "November twenty fourth, twenty twenty six"),
        ("11-24-2026", "November twenty fourth, twenty twenty six"),
        ("2026/11-24", ""),
        ("2026/13/24", ""),
        ("1-2-10", ""),
        ("13/13/2026", ""),
        ("2026-00-10", ""),
        ("1.2.10", ""),
        ("2026-11", ""),
        ("", ""),
    ],
)
def test_dates(written: str, said: str) -> None:
    assert date(written) == said


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("10:30", "ten thirty"),
        ("10:30pm", "ten thirty P.M"),
        ("10:30a.m.", "ten thirty A.M"),
        ("7:00", "seven o'clock"),
        ("7:00pm", "seven P.M"),
        ("14:05", "fourteen oh five"),
        ("14:00", "fourteen hundred"),
        ("0:15", "zero fifteen"),
        ("10:30:01", "ten thirty and one second"),
        ("7pm", "seven P.M"),
        ("25:00", ""),
        ("10:61", ""),
        ("13pm", ""),
        ("3:2", ""),
    ],
)
def test_times(written: str, said: str) -> None:
    assert time(written) == said


def test_parts_of_dates() -> None:
    assert decade("1990s") == "nineteen nineties"
    assert decade("'80s") == "eighties"
    assert decade("1900s") == "nineteen hundreds"
    assert decade("85s") == ""
    assert half_of_day("P.M.") == "P.M"
    assert half_of_day("pmx") == ""
    assert [day("5th"), day("31"), day("32"), day("0")] == [5, 31, 0, 0]
    assert is_year("1066")
    assert not is_year("2200")
    assert telephone("+1-555") == "plus one, five five five"
