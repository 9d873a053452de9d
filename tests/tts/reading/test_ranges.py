import pytest

from app.tts.reading.ranges import between


@pytest.mark.parametrize(
    ("written", "spoken"),
    [
        ("2nd-3rd", "second to third"),
        ("21st—22nd", "twenty first to twenty second"),
        ("10am-5pm", "ten A.M to five P.M"),
        ("10a.m.-5p.m", "ten A.M to five P.M"),
        ("9-5pm", "nine to five P.M"),
        ("10:00-11:30pm", "ten to eleven thirty P.M"),
        ("14:00-15:30", "fourteen hundred to fifteen thirty"),
        ("20%—30%", "twenty to thirty percent"),
        ("5km-10km", "five to ten kilometers"),
        ("50cm-1m", "fifty centimeters to one meter"),
        ("1980s-1990s", "nineteen eighties to nineteen nineties"),
        ("1.5.2026-3.5.2026", "May first, twenty twenty six to May third, twenty twenty six"),
        ("3-5", ""),
        ("13-5pm", ""),
        ("5km-x", ""),
        ("2026-11-24", ""),
        ("F-16", ""),
        ("-5%", ""),
        ("5%-", ""),
    ],
)
def test_between(written: str, spoken: str) -> None:
    assert between(written) == spoken
