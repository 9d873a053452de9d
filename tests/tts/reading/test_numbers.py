import pytest
from hibari.g2p import numbers as hibari_numbers
from hypothesis import given
from hypothesis import strategies as st

from app.tts.reading.numbers import cardinal, digits, fraction, number, ordinal, plural, roman, year


def plain(words: str) -> str:
    """As the other reader writes it, but for its commas, hyphens and its British "and"."""
    return " ".join(word for word in words.replace(",", "").replace("-", " ").split() if word != "and")


@given(st.integers(0, 10**15 - 1))
def test_cardinals_and_ordinals_agree_with_another_reader(value: int) -> None:
    assert cardinal(value) == plain(hibari_numbers.cardinal(value))
    assert ordinal(value) == plain(hibari_numbers.ordinal(value))


def test_numbers_end_somewhere() -> None:
    assert cardinal(10**15).split() == ["one", *["zero"] * 15]
    assert cardinal(-2) == "minus two"
    assert len(cardinal(10**5000)) < 50


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("1999", "nineteen ninety nine"),
        ("1905", "nineteen oh five"),
        ("1900", "nineteen hundred"),
        ("2000", "two thousand"),
        ("2005", "two thousand five"),
        ("2026", "twenty twenty six"),
        ("1066", "ten sixty six"),
        ("800", "eight hundred"),
    ],
)
def test_years(written: str, said: str) -> None:
    assert year(int(written)) == said


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("0", "zero"),
        ("007", "zero zero seven"),
        ("1,234.50", "one thousand two hundred thirty four point five zero"),
        (".5", "zero point five"),
        ("0.05", "zero point zero five"),
    ],
)
def test_numbers(written: str, said: str) -> None:
    assert number(written) == said


def test_parts_of_numbers() -> None:
    assert digits("4-2a0") == "four two zero"
    assert fraction(1, 2) == "one half"
    assert fraction(3, 4) == "three quarters"
    assert fraction(2, 3) == "two thirds"
    assert [plural(word) for word in ("half", "ninety", "six", "day", "fifth")] == [
        "halves", "nineties", "sixes", "days", "fifths"
    ]  # fmt: skip


@given(st.integers(1, 3999))
def test_roman_numerals(value: int) -> None:
    written, rest = "", value
    for letters, worth in [("M", 1000), ("CM", 900), ("D", 500), ("CD", 400), ("C", 100), ("XC", 90), ("L", 50),
                           ("XL", 40), ("X", 10), ("IX", 9), ("V", 5), ("IV", 4), ("I", 1)]:  # fmt: skip
        while rest >= worth:
            written, rest = written + letters, rest - worth
    assert roman(written) == value


@pytest.mark.parametrize("wrong", ["", "IIII", "VX", "iv", "IC", "A", "MMMM", "I" * 100])
def test_what_is_no_roman_numeral(wrong: str) -> None:
    assert roman(wrong) == 0
