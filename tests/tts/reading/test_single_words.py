import pytest

from app.tts.reading.single_words import SingleWords, english


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("COVID-19", "Covid nineteen"),
        ("B2B", "B two B"),
        ("MP3", "M.P three"),
        ("4K", "four K"),
        ("10k", "ten thousand"),
        ("v2.0.1", "version two point zero point one"),
        ("127.0.0.1", "one hundred twenty seven dot zero dot zero dot one"),
        ("3-5", "three to five"),
        ("1990-1995", "nineteen ninety to nineteen ninety five"),
        ("3:2", "three to two"),
        ("10x20", "ten by twenty"),
        ("3×4", "three times four"),
        ("5x", "five times"),
        ("x²", "x squared"),
        ("C++", "C plus plus"),
        ("AT&T", "A.T and T"),
        ("#5", "number five"),
        ("5'10", "five foot ten"),
        ("~10", "about ten"),
        ("word—another", "word— another"),
        ("a\u0301\u0301b1", "a\u0301\u0301 b one"),
        ("1st", "first"),
        ("1,000th", "one thousandth"),
    ],
)
def test_words_with_figures_and_signs(written: str, said: str) -> None:
    assert SingleWords(english, shouted=False).figures(written, "", "") == said


def test_words_of_letters() -> None:
    words = SingleWords(english, shouted=False)
    assert words.word("well-known") == "well-known"
    assert words.word("non-NATO") == "non Nato"
    assert words.word("pre-FBI") == "pre F.B.I"
    assert words.word("McDonald") == "McDonald"
    assert SingleWords(english, shouted=True).word("STOP") == "stop"
    assert words.sign("&", "a", "b") == "and"
    assert words.sign("-", "3", "2") == "minus"
    assert words.sign("-", "a", "b") == ""


def test_years_unless_something_is_counted() -> None:
    words = SingleWords(english, shouted=False)
    assert words.figures("2026", "in", "was") == "twenty twenty six"
    assert words.figures("2026", "", "people") == "two thousand twenty six"


def test_english_words_are_words_and_no_letters() -> None:
    assert english("stop")
    assert not english("fbi")
    assert not english("qwyxzk")
