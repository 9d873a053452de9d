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


@pytest.mark.parametrize("document", ["<speak>Hi</speak>", '\n <speak version="1.1">Hi</speak>'])
def test_ssml_is_known_by_its_beginning(document: str) -> None:
    assert [clause.text for clause in plan(document).clauses] == ["Hi"]
    assert plan(document, markup="text").clauses[0].text.startswith("<speak")


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
