import pytest

from app.errors import InputError, NothingToSay
from app.tts.planning import plan


def test_a_text_is_planned_as_written_and_as_spoken() -> None:
    planned = plan("It costs $3.50 😀. Bye.")
    assert [(clause.text, clause.spoken) for clause in planned.clauses] == [
        ("It costs $3.50.", "It costs three dollars and fifty cents."),
        ("Bye.", "Bye."),
    ]
    assert planned.unread == ("😀",)


def test_the_items_of_a_list_are_spoken_one_by_one() -> None:
    planned = plan("## shopping list\n- eggs\n- `milk` and\n  bread\n> He said\n> so.")
    assert [clause.text for clause in planned.clauses] == ["shopping list", "eggs", "milk and bread", "He said so."]
    assert all(clause.pause > 0 for clause in planned.clauses)


@pytest.mark.parametrize(
    "document",
    [
        "<speak>Hi</speak>",
        '\n <speak version="1.1">Hi</speak>',
        '<?xml version="1.0" encoding="UTF-8"?>\n<!-- a -->\n<speak>Hi</speak>',
    ],
)
def test_ssml_is_known_by_its_beginning(document: str) -> None:
    assert [clause.text for clause in plan(document).clauses] == ["Hi"]
    assert plan(document, markup="text").clauses[0].text != "Hi"


def test_a_document_type_is_refused_and_not_read_aloud() -> None:
    entity = '<!DOCTYPE speak [<!ENTITY x SYSTEM "file:///etc/hostname">]>\n<speak>&x;</speak>'
    for document in (entity, '<?xml version="1.0"?>' + entity):
        with pytest.raises(InputError, match="a document type is not allowed"):
            plan(document)


@pytest.mark.parametrize("text", ["<speaker> is on", "<!-- note --> Hello", "<?xml?> is how it begins", "a <speak>"])
def test_other_angles_are_text(text: str) -> None:
    assert plan(text).clauses


def test_a_long_beginning_takes_no_time() -> None:
    assert plan("<!---->" * 5_000 + "x").clauses
    assert plan("<!--" * 5_000 + "x").clauses


def test_ssml_by_name() -> None:
    assert plan('<?xml version="1.0"?><speak>Hi</speak>', markup="ssml").clauses[0].text == "Hi"
    with pytest.raises(InputError, match="line 1, column 1"):
        plan("Hi", markup="ssml")


@pytest.mark.parametrize("text", ["", "...", "😀", "<speak/>", "<speak><break/><mark name='x'/>...</speak>"])
def test_nothing_to_say(text: str) -> None:
    with pytest.raises(NothingToSay):
        plan(text)


def test_guessed_are_words_that_no_dictionary_has() -> None:
    text = "Qwyxzk paid $3.50 (Zzyxq) on 2026-11-24 to NASA, the FBI and qwyxzk's well-known example.com."
    assert plan(text).guessed == ("Qwyxzk", "Zzyxq", "qwyxzk's")
    own = {"qwyxzk": "K W IH K", "zzyxq": ["Z", "IH1", "K"]}
    assert plan(text, lexicon=own).guessed == ()
    assert plan(text, lexicon=own).lexicon["zzyxq"] == ("Z", "IH", "K")
    with pytest.raises(InputError):
        plan("x", lexicon={"x": "QQ"})


def test_a_lexicon_keeps_its_words_from_being_spelled() -> None:
    assert plan("The FBI.", lexicon={"FBI": "F IH B IY"}).clauses[0].spoken == "The FBI."
