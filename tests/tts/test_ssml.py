import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ssml_documents import DOCUMENT

from app.errors import InputError, TooLong
from app.tts.ssml import DEEPEST, MOST_CHARACTERS, Bookmark, Break, Edge, Said, Style, parse


def said(document: str) -> list[Said]:
    return [item for item in parse(document) if isinstance(item, Said)]


def test_a_document() -> None:
    items = parse(
        '<?xml version="1.0"?>\n<speak version="1.1" xmlns="http://www.w3.org/2001/10/synthesis" xml:lang="en-GB">'
        '<p><s>A &amp; <break time="1.5s"/><mark name="here"/>&#66;</s></p></speak>'
    )
    assert [item if not isinstance(item, Said) else item.text for item in items] == [
        Edge(True), Edge(False), "A & ", Break(1.5), Bookmark("here"), "B", Edge(False), Edge(True)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("element", "seconds"),
    [
        ('<break time="500ms"/>', 0.5),
        ('<break time="2s"/>', 2.0),
        ('<break time=".5s"></break>', 0.5),
        ('<break strength="none"/>', 0.0),
        ("<break/>", 0.3),
        ('<break strength="x-strong" time="0s"/>', 0.0),
    ],
)
def test_breaks(element: str, seconds: float) -> None:
    assert parse(f"<speak>{element}</speak>") == (Break(seconds),)


@pytest.mark.parametrize(
    ("attributes", "style"),
    [
        ('rate="slow"', Style(0.75)),
        ('rate="80%"', Style(0.8)),
        ('rate="+50%"', Style(1.5)),
        ('rate="-50%"', Style(0.5)),
        ('rate="1.5"', Style(1.5)),
        ('volume="+6dB"', Style(1.0, 6.0)),
        ('volume="silent"', Style(1.0, -math.inf)),
        ('rate="fast" volume="soft"', Style(1.25, -6.0)),
        ("", Style()),
    ],
)
def test_prosody(attributes: str, style: Style) -> None:
    (item,) = said(f"<speak><prosody {attributes}>x</prosody></speak>")
    assert item.style == style


def test_prosody_in_prosody_multiplies_and_ends() -> None:
    inner = '<prosody rate="50%" volume="-6dB">b</prosody>'
    document = f'<speak><prosody rate="0.5" volume="-6dB">a{inner}</prosody>c</speak>'
    assert [item.style for item in said(document)] == [Style(0.5, -6.0), Style(0.25, -12.0), Style()]


def test_what_is_read_otherwise() -> None:
    sub, ipa, arpabet, spelled = said(
        '<speak><sub alias="World Wide Web Consortium">W3C</sub><phoneme alphabet="ipa" ph="təˈmeɪtoʊ">tomato</phoneme>'
        '<phoneme alphabet="x-arpabet" ph="r eh1 d">read</phoneme>'
        '<say-as interpret-as="characters">A<!-- no -->BC</say-as></speak>'
    )
    assert (sub.text, sub.alias) == ("W3C", "World Wide Web Consortium")
    assert ipa.phones == ("T", "AH", "M", "EY", "T", "OW")
    assert arpabet.phones == ("R", "EH", "D")
    assert spelled.spoken == "A.B.C"


def refusal(document: str) -> str:
    """What is wrong with a document; nothing if it is understood. Any other error than InputError goes on."""
    try:
        parse(document)
    except InputError as error:
        return error.message
    return ""


BOMB = '<!DOCTYPE speak [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]><speak>&b;</speak>'
OUTSIDE = '<!DOCTYPE speak [<!ENTITY x SYSTEM "file:///etc/passwd">]><speak>&x;</speak>'


@pytest.mark.parametrize(
    ("document", "place", "what"),
    [
        ("<speak>\n<p>a & b</p></speak>", "line 2, column 7", "not well-formed"),
        ("<speak>\n  <foo/></speak>", "line 2, column 3", "element foo"),
        ("<speak>é你😀<foo/></speak>", "line 1, column 11", "element foo"),
        ('<speak>\n\n<break time="x"/></speak>', "line 3, column 1", "time"),
        ('<speak><break time="11s"/></speak>', "line 1, column 8", "10 s"),
        ('<speak><break strength="huge"/></speak>', "line 1, column 8", "strength"),
        ("<speak><break>x</break></speak>", "line 1", "empty"),
        ('<speak>' + '<break time="10s"/>' * 4 + "</speak>", "line 1, column 65", "30 s"),
        ('<speak><prosody rate="0">x</prosody></speak>', "column 8", "rate"),
        ('<speak><prosody rate="-100%">x</prosody></speak>', "column 8", "rate"),
        ('<speak><prosody volume="50">x</prosody></speak>', "column 8", "volume"),
        ('<speak><prosody pitch="high">x</prosody></speak>', "column 8", "pitch"),
        ('<speak><say-as interpret-as="song">x</say-as></speak>', "column 8", "song"),
        ("<speak><say-as>x</say-as></speak>", "column 8", "interpret"),
        ('<speak><say-as interpret-as="cardinal">\nx</say-as></speak>', "line 1, column 8", "cardinal"),
        ('<speak><sub alias="x"> </sub></speak>', "column 8", "no text"),
        ("<speak><sub>x</sub></speak>", "column 8", "alias"),
        ('<speak><phoneme ph="t5">x</phoneme></speak>', "column 8", "'5'"),
        ('<speak><phoneme alphabet="x-arpabet" ph="QQ">x</phoneme></speak>', "column 8", "QQ"),
        ('<speak><phoneme alphabet="klingon" ph="a">x</phoneme></speak>', "column 8", "klingon"),
        ("<speak><phoneme>x</phoneme></speak>", "column 8", "ph"),
        ("<speak><mark/></speak>", "column 8", "name"),
        ('<speak><s><p>x</p></s></speak>', "column 11", "p may not stand in s"),
        ('<speak><p><prosody><p>x</p></prosody></p></speak>', "column 20", "p may not stand in p"),
        ("<speak><speak>x</speak></speak>", "column 8", "speak"),
        ('<speak xml:lang="de">x</speak>', "column 1", "English"),
        ('<speak xmlns="urn:x">x</speak>', "column 1", "namespace"),
        ("<p>x</p>", "column 1", "outermost"),
        ("<speak>" * 1 + "<prosody>" * DEEPEST + "</prosody>" * DEEPEST + "</speak>", "line 1", "deep"),
        ("<speak><?php x?></speak>", "column 8", "instruction"),
        (BOMB, "line 1", "document type"),
        (OUTSIDE, "line 1", "document type"),
        ("<speak>&x;</speak>", "column 8", "entity"),
        ("", "line 1", "no element"),
        ("<speak>\x00</speak>", "line 1", "not well-formed"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_place(document: str, place: str, what: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(document)
    assert place in caught.value.message
    assert what in caught.value.message
    assert caught.value.field == "text"


def test_size_is_bounded() -> None:
    with pytest.raises(TooLong):
        parse("<speak>" + "x" * MOST_CHARACTERS + "</speak>")


@settings(deadline=None)
@given(DOCUMENT)
def test_any_document_of_the_subset_is_understood(document: str) -> None:
    assert "cannot be said as" in (wrong := refusal(document)) or "no text" in wrong or not wrong


@settings(deadline=None)
@given(DOCUMENT, st.data())
def test_broken_documents_are_refused_with_a_place(document: str, data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(document)))
    end = data.draw(st.integers(start, min(len(document), start + 9)))
    broken = document[:start] + data.draw(st.text(max_size=4)) + document[end:]
    wrong = refusal(broken)
    assert not wrong or wrong.startswith("SSML, line ")
