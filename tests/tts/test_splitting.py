import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.tts.splitting import CLAUSE_PAUSE, FIRST_PIECE, LONGEST_PIECE, PARAGRAPH_PAUSE, SENTENCE_PAUSE, split
from app.tts.text import clean, speakable


def pieces(text: str) -> list[str]:
    return [clause.text for clause in split(clean(text).text)]


def readable(text: str) -> str:
    return "".join(character for character in text if character.isalnum())


@pytest.mark.parametrize(
    "text",
    [
        "Mr. Smith met Dr. J. R. Jones at 3.14 p.m. on Jan. 5 in St. Ives.",
        "The U.S. Army, e.g. its cooks, i.e. all of them, left.",
        'He said "Really?" and left.',
        "Wait... what is it?",
        "Apples, pears, etc. are fruit.",
        "Version 2.0.1 costs $3.50 (approx. 3 euros).",
        "See No. 5 and fig. 3 on p. 12.",
        "It is a line\nthat was wrapped.",
    ],
)
def test_one_sentence(text: str) -> None:
    assert "".join(" ".join(pieces(text)).split()) == "".join(text.split())
    assert all(clause.pause != SENTENCE_PAUSE for clause in split(text)[:-1])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("One. Two! Three?", ["One.", "Two!", "Three?"]),
        ('"Go." She went. (It was late.) Then rain.', ['"Go."', "She went.", "(It was late.)", "Then rain."]),
        ("I live in the U.S. It is big.", ["I live in the U.S.", "It is big."]),
        ("We saw cats, dogs, etc. They ran.", ["We saw cats, dogs, etc.", "They ran."]),
        ("No. I will not.", ["No.", "I will not."]),
        ("It was I. Then he came.", ["It was I.", "Then he came."]),
        ("Hello...\n\nWorld", ["Hello...", "World"]),
        ("Shopping\nMilk\nBread", ["Shopping", "Milk", "Bread"]),
        ("1. First point. 2. Second point.", ["1. First point.", "2. Second point."]),
        ("II. Main point. VIII) Last.", ["II. Main point.", "VIII) Last."]),
        ("It was World War II. Then peace.", ["It was World War II.", "Then peace."]),
        ("Really?! Yes.", ["Really?!", "Yes."]),
        ("... !", []),
        ("", []),
        ("🙂", []),
    ],
)
def test_sentences(text: str, expected: list[str]) -> None:
    assert pieces(text) == expected


def test_pauses() -> None:
    text = "One, " + "which is a long clause that goes on and on, " * 4 + "ends. Two.\n\nThree."
    clauses = split(text)
    assert {clause.pause for clause in clauses if clause.text.endswith(",")} == {CLAUSE_PAUSE}
    assert [clause.pause for clause in clauses[-3:]] == [SENTENCE_PAUSE, PARAGRAPH_PAUSE, SENTENCE_PAUSE]


def test_the_first_piece_is_short_where_a_clause_ends_early() -> None:
    long = "When the rain had stopped at last, the whole family went out into the garden to look for the lost key."
    assert pieces(long)[0] == "When the rain had stopped at last,"
    assert len(pieces(long)) == 2
    assert pieces("Well, " + "word " * 20)[0].startswith("Well, word")  # "Well," alone is not worth a break
    later = "Short one. " + long
    assert pieces(later) == ["Short one.", long]  # only the very first is hurried


def test_long_sentences_are_cut_at_the_best_place() -> None:
    clause = "the quick brown fox jumps over the lazy dog in the yard"
    with_commas = pieces("Go. " + f"{clause}, " * 8 + "end.")
    assert all(piece.endswith(",") for piece in with_commas[1:-1])
    with_and = pieces("Go. " + f"{clause} and " * 8 + "end.")
    assert all(piece.startswith("and ") for piece in with_and[2:])


BITS = [*"aAbBzZ019 .,;:!?—-\"'()\n", "Mr. ", "and ", ". The ", "3.5 "]
ANY = st.lists(st.sampled_from(BITS), max_size=600).map("".join)


@given(ANY)
def test_nothing_is_lost_and_no_piece_is_long(text: str) -> None:
    clauses = split(text)
    assert readable(" ".join(clause.text for clause in clauses)) == readable(text)
    assert all(0 < len(clause.text) <= LONGEST_PIECE for clause in clauses)
    assert all(speakable(clause.text) and clause.pause >= 0 for clause in clauses)


@given(st.lists(st.text(alphabet=string.ascii_letters + "'", min_size=1, max_size=12), max_size=80))
def test_words_stay_whole_and_in_order(words: list[str]) -> None:
    spoken = " ".join(clause.text for clause in split(" ".join(words))).split()
    assert [word for word in spoken if readable(word)] == [word for word in words if readable(word)]


@given(ANY)
def test_the_first_piece_is_short_if_it_is_cut(text: str) -> None:
    clauses = split(text)
    if clauses and clauses[0].pause == CLAUSE_PAUSE and "\n" not in text and len(text) <= LONGEST_PIECE:
        assert len(clauses[0].text) <= FIRST_PIECE


PARTS = [
    "a", "a ", ". ", ".", ",", " ", "\n", "\n ", "A.", "U.S. ", "“", "(", "[", "[a](", "-", "— ", "1", "1,", "😀",
    "你", "#", "\u0301", "a\u0301\u0323", "Mr. ", "é", "\"'", "a, ", "\u200d", "  \t", "\x00", "½", "# ",
    "* ", "–", "1–",
]  # fmt: skip


@pytest.mark.parametrize("part", PARTS)
def test_twenty_thousand_of_anything(part: str) -> None:
    text = (part * 20_000)[:20_000]
    for whole in (text, text + "x", "x" + text):
        cleaned = clean(whole)
        clauses = split(cleaned.text)
        assert readable("".join(clause.text for clause in clauses)) == readable(cleaned.text)
        split(whole)  # not cleaned
