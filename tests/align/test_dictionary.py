import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.align import dictionary
from app.align.dictionary import MOST_PRONUNCIATIONS, Dictionary
from app.errors import InputError
from app.speech import PHONES, SILENCE

PLAIN = Dictionary()


def said(written: str) -> list[str]:
    return [" ".join(phones) for phones in PLAIN.word(written).pronunciations]


@pytest.mark.parametrize(
    ("written", "phones"),
    [
        ("“Hello,”", ["HH AH L OW", "HH EH L OW"]),
        ("Don’t", ["D OW N T", "D OW N"]),
        ("READ", ["R EH D", "R IY D"]),
        ("m", ["EH M"]),
        ("well-known", ["W EH L N OW N"]),
        ("Anna's", ["AE N AH Z"]),
        ("e.g.", ["IY JH IY"]),
    ],
)
def test_known_words(written: str, phones: list[str]) -> None:
    assert said(written) == phones
    assert not PLAIN.word(written).guessed


@pytest.mark.parametrize(
    ("written", "phones"),
    [
        ("1984", "N AY N T IY N EY T IY F AO R"),
        ("10:30", "T EH N TH ER T IY"),
        ("50%", "F IH F T IY P ER S EH N T"),
        ("$3.50", "TH R IY D AA L ER Z AE N D F IH F T IY S EH N T S"),
        ("&", "AE N D"),
        ("nuoyen", "N OY AH N"),
        ("café", "K AE F EY"),
    ],
)
def test_everything_else_is_guessed(written: str, phones: str) -> None:
    word = PLAIN.word(written)
    assert word.guessed
    assert word.text == written
    assert said(written) == [phones]


@pytest.mark.parametrize("written", ["…", "—", "😀", "привет", "'", "“”"])
def test_some_words_have_no_sound(written: str) -> None:
    assert PLAIN.word(written).pronunciations == ()


def test_amounts_of_millions() -> None:
    three, million, more = PLAIN.read("$3 million, more")
    assert [word.text for word in (three, million, more)] == ["$3", "million,", "more"]
    assert " ".join(three.pronunciations[0]) == "TH R IY"
    assert " ".join(million.pronunciations[0]) == "M IH L Y AH N D AA L ER Z"


def test_a_lexicon_comes_first() -> None:
    own = Dictionary({"Hello": "HH EH1 L AA0", "zyx": ("Z", "IH", "K", "S"), "dr.": "D AA K T ER"})
    assert own.word("hello!").pronunciations == (("HH", "EH", "L", "AA"),)
    assert own.word("ZYX's").pronunciations == (("Z", "IH", "K", "S", "IH", "Z"),)
    assert not own.word("Zyx").guessed
    assert own.word("Dr.").pronunciations == (("D", "AA", "K", "T", "ER"),)


@pytest.mark.parametrize("phones", ["HH EH L QQ", "SIL", ""])
def test_a_lexicon_of_no_phones_is_refused(phones: str) -> None:
    with pytest.raises(InputError, match="hello"):
        Dictionary({"hello": phones})


def test_alternatives_are_limited() -> None:
    assert 1 < len(PLAIN.word("and-the-a-read-and-the-a-either").pronunciations) <= MOST_PRONUNCIATIONS


def test_without_the_voice_words_are_spelled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dictionary, "_reader", lambda: None)
    assert PLAIN.word("shlampter").pronunciations == (("SH", "L", "AE", "M", "P", "T", "ER"),)


@given(st.text(max_size=30))
def test_any_text_has_only_phones(text: str) -> None:
    for word in PLAIN.read(text):
        for phones in word.pronunciations:
            assert phones
            assert set(phones) <= set(PHONES) - {SILENCE}


def test_what_it_knows() -> None:
    dictionary = Dictionary({"qwyxzk": "K W IH K"})
    assert all(map(dictionary.knows, ["Hello,", "dog's", "well-known", "QWYXZK", "qwyxzk's", "...", "5"]))
    assert not any(map(dictionary.knows, ["zzyxq", "well-zzyxq", "你"]))
