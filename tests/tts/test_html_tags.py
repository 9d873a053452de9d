import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.tts.html_tags import strip_html
from app.tts.text import clean


@pytest.mark.parametrize(
    ("written", "plain"),
    [
        ("Do <b>this</b> and <EM>that</EM>.", "Do this and that."),
        ("x<sup>2</sup>, <i >y</i>, <span class='a' id=b>z</span>", "x2, y, z"),
        ('See <a href="https://example.org/?a=1&amp;b=2">here</a>.', "See here."),
        ("one<br>two<br/>three<BR />four", "one\ntwo\nthree\nfour"),
        ("<p>One.</p><p>two</p>", "\n\nOne.\n\n\n\ntwo\n\n"),
        ("<tr><td>a</td><td>b</td></tr>", "\n\n a  b \n\n"),
        ("fish &amp; chips &lt;now&gt; &quot;hi&quot;", 'fish & chips <now> "hi"'),
        ("it&#39;s &#x263a; caf&eacute;", "it's ☺ café"),
        ("a&nbsp;b", "a\xa0b"),
        ("&lt;b&gt;", "<b>"),  # written to be seen
        ("AT&T; R&D, &nosuch; &notit; &amp", "AT&T; R&D, &nosuch; &notit; &amp"),
        ("a < b > c, a<b and c>d, 1 <2> 3", "a < b > c, a<b and c>d, 1 <2> 3"),
        ("<name>, List<String>, vector<int>, <https://a.b>", "<name>, List<String>, vector<int>, <https://a.b>"),
        ("<3 </3 <> </> <b", "<3 </3 <> </> <b"),
    ],
)  # fmt: skip
def test_strip_html(written: str, plain: str) -> None:
    assert strip_html(written) == plain


def test_clean_takes_tags_and_references_out_of_plain_text_only() -> None:
    assert clean("<p>Salt &amp; <b>*pepper*</b></p>\n<p>more&nbsp;of it</p>").text == "Salt & pepper\n\nmore of it"
    assert clean("a <b>c</b> &amp;", markdown=False).text == "a <b>c</b> &amp;"


@given(st.text(alphabet="ab <>/&;=\"'\n", max_size=80))
def test_nothing_is_added_and_text_without_tags_is_left_alone(text: str) -> None:
    plain = strip_html(text)
    assert len(plain) <= len(text)
    if "<a" not in text and "</a" not in text and "<b" not in text and "</b" not in text:
        assert plain == text


@pytest.mark.parametrize(
    "bit", ["<", "<a ", "<b", "<a b=", '<a b="', "<a b=c ", "&", "&a", "&amp;", "&#1", "<b>", "\n"]
)
def test_long_messes_take_no_time(bit: str) -> None:
    strip_html((bit * 50_000)[:50_000])
    strip_html("<a " + (bit * 50_000)[:50_000] + ">")
