from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.align.dictionary import NO_LEXICON, Lexicon
from app.errors import Gone, InputError, NothingToSay, OverCapacity
from app.speech import Speech
from app.tts.live_text import HOLD_SENTENCE, HOLD_WORDS, LiveText, complete
from app.tts.mock import MockEngine
from app.tts.splitting import LONGEST_PIECE


class Engine(MockEngine):
    """Remembers what it spoke."""

    def __init__(self) -> None:
        super().__init__()
        self.spoken: list[str] = []

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        self.spoken.append(text)
        return super().speak(text, voice=voice, speed=speed, lexicon=lexicon)


class Writing:
    """A text in the making, with a clock that a test turns."""

    def __init__(self, limit: int = 10_000) -> None:
        self.now = 0.0
        self.engine = Engine()
        self.text = LiveText(self.engine, voice="", limit=limit, clock=lambda: self.now, wait=0.0)
        self._speeches = self.text.speeches()

    def speak(self) -> list[Speech]:
        """What can be spoken now."""
        return list(itertools.takewhile(lambda speech: speech is not None, self._speeches))  # type: ignore[arg-type]

    def spoken(self) -> list[str]:
        self.engine.spoken.clear()
        self.speak()
        return self.engine.spoken


@pytest.mark.parametrize(
    ("text", "ready"),
    [
        ("Hello there.", ""),  # more may follow: 3.5, example.org
        ("Hello there. ", ""),
        ("Hello there. H", "Hello there."),
        ("Really? Yes", "Really?"),
        ("One. Two! Three", "One. Two!"),
        ("Dr. Jones came, and", "Dr. Jones came,"),
        ("So, I", ""),  # too short for a breath
        ("It costs 1,", ""),
        ("It costs a lot, 1,000 in fact", "It costs a lot,"),
        ("no end in sight and", ""),
        ("A title\n\nThen", "A title"),
        ("1. First", ""),
        ("e.g. this", ""),
        ("", ""),
        ("   ", ""),
    ],
)
def test_whole_sentences_are_ready_else_whole_clauses(text: str, ready: str) -> None:
    assert text[: complete(text)] == ready


@given(st.text(alphabet="ab .,!?\n1", max_size=2 * LONGEST_PIECE))
def test_a_text_is_never_longer_than_a_piece_without_any_of_it_being_ready(text: str) -> None:
    size = complete(text)
    assert 0 <= size <= len(text)
    assert size or len(text) <= LONGEST_PIECE
    if text[:size].strip() and len(text) <= LONGEST_PIECE:
        assert text[:size][-1].strip()  # words are never cut


@settings(deadline=None)
@given(st.lists(st.text(alphabet="abc .,!?\n", max_size=9), max_size=60))
def test_nothing_that_is_written_is_lost(tokens: list[str]) -> None:
    writing = Writing()
    said: list[Speech] = []
    for token in tokens:
        writing.text.push(token)
        said += writing.speak()
    writing.text.end()
    try:
        said += writing.speak()
    except NothingToSay:
        assert not any(map(str.isalnum, "".join(tokens)))
    written = "".join(word.text for speech in said for word in speech.words)
    letters = [letter for letter in written if letter.isalnum()]
    assert letters == [letter for letter in "".join(tokens) if letter.isalnum()]


def test_speech_begins_before_the_text_is_complete() -> None:
    writing = Writing()
    for token in ("Hel", "lo, my", " friend", ", how"):
        assert writing.spoken() == []
        writing.text.push(token)
    assert writing.spoken() == ["Hello, my friend,"]
    writing.text.push(" are you? I")
    assert writing.spoken() == ["how are you?"]
    writing.text.push(" am fine")
    assert writing.spoken() == []
    writing.text.end()
    assert writing.spoken() == ["I am fine"]
    assert writing.text.characters == len("Hello, my friend, how are you? I am fine")


def test_a_clause_has_a_shorter_pause_than_a_sentence() -> None:
    writing = Writing()
    writing.text.push("Hello, my friend, how")
    (clause,) = writing.speak()
    writing.text.push(" are you today? I")
    (sentence,) = writing.speak()
    assert clause.phones[-1].end - clause.phones[-1].start < sentence.phones[-1].end - sentence.phones[-1].start


def test_a_full_stop_with_nothing_after_it_ends_a_sentence_after_a_moment() -> None:
    writing = Writing()
    writing.text.push("That is all.")
    assert writing.spoken() == []
    writing.now = HOLD_SENTENCE
    assert writing.spoken() == ["That is all."]


def test_words_that_nobody_goes_on_with_are_spoken_after_a_while() -> None:
    writing = Writing()
    writing.text.push("And then")
    writing.now = HOLD_SENTENCE
    assert writing.spoken() == []
    writing.now = HOLD_WORDS
    assert writing.spoken() == ["And then"]


def test_a_flush_speaks_what_is_there_and_no_more() -> None:
    writing = Writing()
    writing.text.push("Now")
    writing.text.flush()
    writing.text.push(" or never, I")
    assert writing.spoken() == ["Now"]
    writing.text.end()
    assert writing.spoken() == ["or never, I"]


def test_too_much_that_waits_is_refused_whole() -> None:
    writing = Writing(limit=20)
    writing.text.push("Twenty characters...")
    with pytest.raises(OverCapacity):
        writing.text.push("!")
    writing.text.end()
    assert writing.spoken() == ["Twenty characters..."]


def test_after_the_end_nothing_can_be_written() -> None:
    writing = Writing()
    writing.text.end()
    writing.text.end()
    with pytest.raises(Gone):
        writing.text.push("more")


def test_what_cannot_be_read_is_told_and_nothing_else_is_lost() -> None:
    writing = Writing()
    writing.text.push("🙂🙂 \n\nHi ☃ there. 🙂🙂 ")
    writing.text.end()
    assert writing.spoken() == ["Hi there."]
    assert writing.text.unread == ("🙂🙂", "☃")


def test_a_text_without_anything_readable_says_so_at_the_end() -> None:
    writing = Writing()
    writing.text.push("🙂")
    writing.text.end()
    with pytest.raises(NothingToSay):
        writing.speak()


def test_speed_is_checked_at_once() -> None:
    with pytest.raises(InputError):
        LiveText(Engine(), voice="", speed=3.0)


def test_waiting_for_text_ends_with_the_text() -> None:
    text = LiveText(Engine(), voice="")
    made: list[Speech | None] = []

    def listen(speeches: Iterator[Speech | None]) -> None:
        made.extend(speeches)

    thread = threading.Thread(target=listen, args=(text.speeches(),))
    thread.start()
    for token in ["Hello", "there,", "you.", "How", "are", "you?"]:
        text.push(token + " ")
    text.end()
    thread.join(20)
    assert not thread.is_alive()
    assert sum(speech is not None for speech in made) >= 1
