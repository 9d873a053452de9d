import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.align.spelling import spell
from app.speech import PHONES, SILENCE


@pytest.mark.parametrize(
    ("word", "phones"),
    [
        ("shatter", "SH AE T ER"),
        ("Crate", "K R AE T"),
        ("quilted", "K W IH L T EH D"),
        ("BBC", "B IY B IY S IY"),
        ("a", "EY"),
        ("42", "F AO R T UW"),
        ("Łódź", "OW D Z"),
        ("крот", ""),
        ("😀", ""),
    ],
)
def test_spelled(word: str, phones: str) -> None:
    assert " ".join(spell(word)) == phones


@given(st.text(max_size=40))
def test_whatever_is_written_there_are_only_phones(word: str) -> None:
    assert set(spell(word)) <= set(PHONES) - {SILENCE}
