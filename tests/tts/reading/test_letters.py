import pytest

from app.tts.reading.letters import initials, sayable, spelled, spelled_plural


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("FBI", "F.B.I"),
        ("US", "U.S"),
        ("IT", "I.T"),
        ("CDs", "C D's"),
        ("APIs", "A.P I's"),
        ("AI's", "A-I's"),
        ("mRNA", "M R.N.A"),
        ("PhD", "P.H.D"),
        ("NASA", ""),
        ("NATO's", ""),
        ("COVID", ""),
        ("Paris", ""),
        ("A", ""),
        ("ZYXELON", ""),
    ],
)
def test_initials(word: str, said: str) -> None:
    assert initials(word) == said


def test_capitals_of_a_shout_are_words() -> None:
    assert initials("STOP", known=True) == ""
    assert initials("IT", shouted=True, known=True) == ""
    assert initials("XQZ", shouted=True) == "X.Q.Z"


def test_spelling() -> None:
    assert spelled("abc") == "A.B.C"
    assert spelled_plural("a") == "A's"
    assert sayable("shop")
    assert not sayable("bbc")
