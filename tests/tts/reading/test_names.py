import pytest

from app.tts.reading.names import abbreviation, capitalised, roman_enumerator, roman_numeral


@pytest.mark.parametrize(
    ("word", "dotted", "before", "following", "said"),
    [
        ("Dr", True, "", "Smith", "Doctor"),
        ("Dr", True, "Elm", "near", "Drive"),
        ("St", True, "", "Paul", "Saint"),
        ("St", True, "Main", "", "Street"),
        ("St", True, "5th", "is", "Street"),
        ("Mr", False, "", "Smith", "Mister"),
        ("Rep", False, "", "Smith", ""),
        ("No", True, "", "5", "number"),
        ("No", True, "", "I", ""),
        ("p", True, "", "12", "page"),
        ("etc", True, "cats", "", "et cetera"),
        ("vs", False, "cats", "dogs", "versus"),
        ("e.g", True, "", "cats", "for example"),
        ("cat", True, "", "", ""),
    ],
)
def test_abbreviations(word: str, dotted: bool, before: str, following: str, said: str) -> None:
    assert abbreviation(word, dotted, before, following) == said


@pytest.mark.parametrize(
    ("word", "before", "following", "said"),
    [
        ("IV", "Chapter", "", "four"),
        ("iv", "Chapter", "", ""),
        ("VIII", "Henry", "", "the eighth"),
        ("V", "George", "was", "the fifth"),
        ("II", "War", "", "two"),
        ("I", "War", "", "one"),
        ("I", "chapter", "say", ""),
        ("I", "Elizabeth", "was", "the first"),
        ("I", "Elizabeth", "think", ""),
        ("I", "", "am", ""),
        ("XIV", "Louis", "", "the fourteenth"),
        ("III", "Rocky", "", "three"),
        ("X", "Malcolm", "", ""),
        ("MC", "the", "", ""),
    ],
)
def test_roman_numerals(word: str, before: str, following: str, said: str) -> None:
    assert roman_numeral(word, before, following) == said


def test_capitals() -> None:
    assert capitalised("Über")
    assert not capitalised("")


def test_roman_enumerators() -> None:
    assert [roman_enumerator(word) for word in ("II", "XIV", "I", "V", "IIII", "CD", "ii", "")] == [
        "two",
        "fourteen",
        *[""] * 6,
    ]
