import pytest
from hibari.g2p import numbers as hibari_numbers
from hypothesis import given
from hypothesis import strategies as st

from app.tts.reading.numbers import (
    cardinal,
    digits,
    fraction,
    number,
    ordinal,
    plural,
    roman,
    scientific,
    with_commas,
    year,
)


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


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("3.2e-5", "three point two times ten to the minus five"),
        ("1E+06", "one times ten to the six"),
        ("6.02e23", "six point zero two times ten to the twenty three"),
        ("2e", ""),
        ("e5", ""),
        ("1e5.5", ""),
    ],
)
def test_scientific(written: str, said: str) -> None:
    assert scientific(written) == said


@pytest.mark.parametrize(
    ("written", "commas"),
    [
        ("1.000.000", "1,000,000"),
        ("-12.345.678,90€", "-12,345,678.90€"),
        ("10'000", "10,000"),
        ("$1'234'567.50", "$1,234,567.50"),
        ("1.234.567.890", "1,234,567,890"),
        *((same, same) for same in ("1.000", "1.00.000", "0.123.456", "10.100.200.100", "v1.000.000", "1.000.000.5")),
        *((same, same) for same in ("10'00", "5'10", "1'000.000", "don't", "24.11.2026", "1.000'000", "")),
    ],
)
def test_with_commas(written: str, commas: str) -> None:
    assert with_commas(written) == commas


@given(st.integers(10**6, 10**15))
def test_every_grouping_is_the_same_number(value: int) -> None:
    assert with_commas(f"{value:,}".replace(",", "'")) == f"{value:,}"
    assert with_commas(f"{value:,}".replace(",", ".")) in (f"{value:,}", f"{value:,}".replace(",", "."))
    assert number(with_commas(f"{value:,}".replace(",", "'"))) == number(str(value))


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
