from __future__ import annotations

import re
from collections.abc import AsyncIterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.stream.captions import HEADER, KEPT_WORDS, Captions, SpokenWord, complete, cue, document, phrases
from app.stream.events import Event


def said(text: str, utterance: str = "u", start: float = 0.0, each: float = 0.3) -> list[SpokenWord]:
    return [
        SpokenWord(utterance, word, start + n * each, start + (n + 1) * each - 0.05)
        for n, word in enumerate(text.split())
    ]


def texts(words: list[SpokenWord]) -> list[str]:
    return [" ".join(word.text for word in phrase) for phrase in phrases(words)]


def test_phrases_end_with_sentences_and_full_lines() -> None:
    words = said('Hello. "How are you?" I have been waiting here for such a very long time, said she')
    assert texts(words) == [
        "Hello.",
        '"How are you?"',
        "I have been waiting here for such a very long",
        "time, said she",
    ]


def test_phrases_end_with_utterances_and_at_silences() -> None:
    assert texts([*said("one two"), *said("three", "v", 0.7), *said("four", "v", 2.0)]) == ["one two", "three", "four"]


def test_a_cue_has_the_time_of_every_word_and_no_markup_of_the_text() -> None:
    words = [SpokenWord("u", "A<b>", 3599.5, 3600.0), SpokenWord("u", "&", 3600.25, 3600.5)]
    assert cue(words) == "00:59:59.500 --> 01:00:00.500\nA&lt;b&gt; <01:00:00.250>&amp;\n\n"
    assert cue(words, 3599.0) == "00:00:00.500 --> 00:00:01.500\nA&lt;b&gt; <00:00:01.250>&amp;\n\n"


@given(
    st.lists(st.tuples(st.text(min_size=1, max_size=12), st.floats(0.01, 2), st.floats(0, 1.5)), max_size=40),
    st.floats(0, 7200),
)
def test_a_document_is_webvtt_whatever_the_words_are(spoken: list[tuple[str, float, float]], start: float) -> None:
    captions = Captions()
    for text, length, gap in spoken:
        captions.add(SpokenWord("u", text, start + gap, start + gap + length))
        start += gap + length
    head, *blocks = document(captions.words()).split("\n\n")
    assert head == "WEBVTT"
    assert blocks.pop() == ""
    ends = 0.0
    for block in blocks:
        times, text = block.split("\n")
        assert "-->" not in text
        first, last = (seconds(time) for time in times.split(" --> "))
        assert ends - 0.002 <= first < last
        inside = [seconds(time) for time in re.findall(r"<([\d:.]+)>", text)]
        assert all(first <= time <= last for time in inside)
        assert re.sub(r"<[\d:.]+>", "", text).count("<") == 0
        ends = last


def seconds(stamp: str) -> float:
    hours, minutes, rest = stamp.split(":")
    return 3600 * int(hours) + 60 * int(minutes) + float(rest)


def test_what_is_cut_short_was_not_said() -> None:
    captions = Captions()
    for word in said("one two three four"):
        captions.add(word)
    captions.cut(0.75)
    assert [(word.text, word.end) for word in captions.words()] == [
        ("one", 0.25),
        ("two", pytest.approx(0.55)),
        ("three", 0.75),
    ]
    captions.cut(0.62)  # of the third hardly anything was heard
    assert [word.text for word in captions.words()] == ["one", "two"]


async def test_captions_are_followed_phrase_by_phrase() -> None:
    captions = Captions()
    early, late = said("Hello. How are"), said("you? Bye", start=1.0)
    for word in early:
        captions.add(word)

    async def events() -> AsyncIterator[Event]:
        yield Event("state")
        for word in late:
            captions.add(word)
            yield Event("word")
        yield Event("speak_ended")

    told = [part async for part in captions.follow(events())]
    assert told == [HEADER, *(cue(phrase) for phrase in ([early[0]], [*early[1:], late[0]], [late[1]]))]
    assert "".join(told) == document(captions.words())


def test_words_since_a_moment() -> None:
    captions = Captions()
    for word in said("one two three"):
        captions.add(word)
    assert [word.text for word in captions.since(0.0)] == ["two", "three"]
    assert captions.since(0.6) == []


def test_words_of_one_utterance_and_no_more_than_a_bound() -> None:
    captions = Captions()
    for n in range(KEPT_WORDS + 5):
        captions.add(SpokenWord("even" if n % 2 == 0 else "odd", str(n), n, n + 1))
    assert len(captions.words()) == KEPT_WORDS
    assert captions.words("odd")[-1].text == str(KEPT_WORDS + 3)


def test_a_phrase_is_complete_when_nothing_can_be_added() -> None:
    assert complete(said("Yes."))
    assert complete(said("Is it?)"))
    assert not complete(said("Well, then"))
    assert complete(said("word " * 9))
