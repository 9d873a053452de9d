import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.tts.text import clean, fold, speakable


def readable(text: str) -> str:
    return "".join(character for character in text if character.isalnum())


@pytest.mark.parametrize(
    ("raw", "text", "unread"),
    [
        ("Hello  world\t!", "Hello world!", ()),
        ("“Curly” ‘quotes’ – and — dashes -- here", "\"Curly\" 'quotes' — and — dashes — here", ()),
        ("pages 3–5, −2°C", "pages 3-5, -2°C", ()),
        ("Hi 😀!", "Hi!", ("😀",)),
        ("a 👨‍👩‍👧 b ❤️ c 🇩🇪 d 👍🏽", "a b c d", ("👨‍👩‍👧", "❤️", "🇩🇪", "👍🏽")),
        ("你好, world 你好", ", world", ("你好",)),
        ("Привет мир and नमस्ते.", "and.", ("Привет", "мир", "नमस्ते")),
        ("café naïve Łódź Ærø", "café naïve Łódź Ærø", ()),
        ("cafe\u0301", "café", ()),
        ("Z\u0351\u0343\u036b\u036ba\u0489lgo", "Zalgo", ()),
        ("ﬁne ｆｕｌｌ 𝐛𝐨𝐥𝐝 ①", "fine full bold 1", ()),
        ("x² is 1½", "x² is 1½", ()),
        ("\ufeffzero\u200bwidth\x00\x07 soft\u00adhyphen", "zerowidth softhyphen", ()),
        ("one\r\ntwo\u2028three\n \n\n\nfour", "one\ntwo\nthree\n\nfour", ()),
        ("# Title\n- one\n* two", "Title\n\none\n\ntwo", ()),
        ("see [the page](https://example.org/a)", "see the page", ()),
        ("Wait…", "Wait...", ()),
        ("\ud83d alone", "alone", ("\N{REPLACEMENT CHARACTER}",)),
        ("😀😀 x 😀😀", "x", ("😀😀",)),
        ("", "", ()),
    ],
)
def test_clean(raw: str, text: str, unread: tuple[str, ...]) -> None:
    cleaned = clean(raw)
    assert (cleaned.text, cleaned.unread) == (text, unread)


@given(st.text(max_size=200))
def test_cleaning_twice_changes_nothing_and_reports_nothing(raw: str) -> None:
    once = clean(raw)
    twice = clean(once.text)
    assert twice.unread == ()
    assert readable(twice.text) == readable(once.text)
    once.text.encode()
    "".join(once.unread).encode()


@given(st.text(alphabet=string.ascii_letters + string.digits + " .,;!?'\n", max_size=200))
def test_plain_english_is_left_alone(raw: str) -> None:
    assert readable(clean(raw).text) == readable(raw)


def test_fold() -> None:
    assert fold("Łódź ệ œ café ŋ") == "Lódz e oe café ng"
    assert fold("你") == "你"


def test_speakable() -> None:
    assert speakable("a")
    assert speakable("5")
    assert speakable("&")
    assert not speakable("... ?! — \"'")
