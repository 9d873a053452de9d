from math import inf

from app.tts.clause import Clause
from app.tts.planning import plan
from app.tts.splitting import CLAUSE_PAUSE, PARAGRAPH_PAUSE, SENTENCE_PAUSE


def clauses(inner: str) -> tuple[Clause, ...]:
    return plan(f"<speak>{inner}</speak>").clauses


def marks(inner: str) -> list[list[tuple[str, int, float]]]:
    return [[(mark.name, mark.reading, mark.after) for mark in clause.marks] for clause in clauses(inner)]


def test_sentences_and_paragraphs() -> None:
    made = clauses("<p><s>One</s><s>Two, three</s></p>\n<p>Four. Five\nsix</p>")
    assert [(clause.text, clause.pause) for clause in made] == [
        ("One", SENTENCE_PAUSE),
        ("Two, three", PARAGRAPH_PAUSE),
        ("Four.", SENTENCE_PAUSE),
        ("Five six", SENTENCE_PAUSE),
    ]


def test_breaks_stand_for_the_pause_of_the_punctuation() -> None:
    first, second = clauses('<break time="1s"/>One, <break time="200ms"/><break time="0.1s"/>two.')
    assert (first.text, first.lead, first.pause, round(first.silence, 6)) == ("One,", 1.0, 0.0, 0.3)
    assert (second.text, second.lead, second.pause, second.silence) == ("two.", 0.0, SENTENCE_PAUSE, 0.0)


def test_prosody_cuts_with_the_pause_of_the_punctuation() -> None:
    made = clauses('One <prosody rate="slow">two,</prosody><prosody volume="silent"> three.</prosody> Four')
    assert [(clause.text, clause.pause, clause.speed, clause.gain) for clause in made] == [
        ("One", 0.0, 1.0, 0.0),
        ("two,", CLAUSE_PAUSE, 0.75, 0.0),
        ("three.", SENTENCE_PAUSE, 1.0, -inf),
        ("Four", SENTENCE_PAUSE, 1.0, 0.0),
    ]


def test_words_that_are_read_otherwise() -> None:
    (clause,) = clauses(
        'The <sub alias="World Wide Web">W3 C</sub>, un<phoneme ph="foʊ">fo</phoneme>ly '
        '(<say-as interpret-as="ordinal">3</say-as>) "<sub alias="smile, $5">:)</sub>".'
    )
    assert clause.text == 'The W3 C, unfoly (3) ":)".'
    assert clause.spoken == "The World Wide Web, un fo ly (third) smile, five dollars."
    assert dict(clause.lexicon) == {"fo": ("F", "OW")}
    assert [reading.text for reading in clause.readings] == ["The", "W3 C,", "unfoly", "(3)", '":)".']


def test_a_pronunciation_holds_for_its_word_alone() -> None:
    first, second = clauses('I <phoneme ph="ɹɛd">read</phoneme> what I read.')
    assert dict(first.lexicon) == {"read": ("R", "EH", "D")}
    assert (second.spoken, dict(second.lexicon)) == ("read.", {})


def test_marks_stand_before_words_at_ends_and_in_silences() -> None:
    assert marks('<mark name="a"/>One <mark name="b"/>two<mark name="c"/>.') == [
        [("a", 0, 0), ("b", 1, 0), ("c", 2, 0)],
    ]
    assert marks('<s>One</s><mark name="a"/><s><mark name="b"/>Two</s>') == [[], [("a", 0, 0), ("b", 0, 0)]]
    assert marks('One<break time="1s"/><mark name="a"/><break time="1s"/>two') == [[("a", 1, 1.0)], []]
    assert marks('<break time="1s"/><mark name="a"/><break time="1s"/>two') == [[("a", -1, 1.0)]]
    assert marks('One. <mark name="a"/>') == [[("a", 1, 0)]]
    assert marks('It is $3 <mark name="a"/>million') == [[("a", 3, 0)]]
    assert marks('... <mark name="a"/> <prosody rate="slow">Two</prosody>') == [[("a", 0, 0)]]


def test_unread_is_told() -> None:
    planned = plan('<speak>Hi 😀 <sub alias="你 x">y</sub></speak>')
    assert planned.unread == ("😀", "你")


def test_a_long_document_is_cut_as_a_text_is() -> None:
    made = clauses("word " * 200)
    assert len(made) > 4
    assert all(len(clause.text) <= 200 for clause in made)
    assert len(clauses("x" * 1000)) == 5
