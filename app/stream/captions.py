"""What was said, as captions: WebVTT with the time of every word (W3C, "WebVTT: The Web Video Text Tracks Format")."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import AsyncIterator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from app.stream.events import Event

KEPT_WORDS = 20_000
"""Words a stream remembers, about two hours of speech; the oldest is forgotten."""
LONGEST_PHRASE = 42
"""Characters of a cue that may be exceeded by its last word: a line of subtitles."""
LONGEST_GAP = 0.8
"""Seconds of silence after which a new cue begins."""
LEAST_SECONDS = 0.05
"""A word that is cut off before this much of it is heard was not said."""

HEADER = "WEBVTT\n\n"


@dataclass(frozen=True, slots=True)
class SpokenWord:
    """A word as it is written, and when it is heard: seconds on the stream's clock."""

    utterance: str
    text: str
    start: float
    end: float


class Captions:
    """The last words of a stream, in the order they are heard."""

    def __init__(self) -> None:
        self._words: deque[SpokenWord] = deque(maxlen=KEPT_WORDS)

    def add(self, word: SpokenWord) -> None:
        """One more word; one that shows nothing is left out, since an empty line ends a cue."""
        if word.text.strip():
            self._words.append(word)

    def cut(self, seconds: float) -> None:
        """What follows this moment was not said after all."""
        while self._words and self._words[-1].start + LEAST_SECONDS > seconds:
            self._words.pop()
        if self._words and self._words[-1].end > seconds:
            self._words.append(replace(self._words.pop(), end=seconds))

    def since(self, seconds: float) -> list[SpokenWord]:
        """The words that begin after this moment."""
        later = list(itertools.takewhile(lambda word: word.start > seconds, reversed(self._words)))
        return later[::-1]

    async def follow(self, events: AsyncIterator[Event]) -> AsyncIterator[str]:
        """A WebVTT document of all words so far that goes on, phrase by phrase.

        Args:
            events: "word" and "speak_ended", at least; it ends with them.
        """
        yield HEADER
        told = -math.inf  # start of the last word told
        async for event in events:
            groups = list(phrases(self.since(told)))
            if groups and event.name != "speak_ended" and not complete(groups[-1]):
                groups.pop()  # it may go on
            for phrase in groups:
                yield cue(phrase)
                told = phrase[-1].start

    def words(self, utterance: str | None = None) -> list[SpokenWord]:
        """All words, or those of one utterance."""
        return [word for word in self._words if utterance in (None, word.utterance)]


def phrases(words: Iterable[SpokenWord]) -> Iterator[tuple[SpokenWord, ...]]:
    """Words in groups that are read at a glance: they end with a sentence, with an utterance, at a silence, or when a
    line is full."""
    phrase: list[SpokenWord] = []
    for word in words:
        if phrase and (complete(phrase) or _apart(phrase[-1], word)):
            yield tuple(phrase)
            phrase = []
        phrase.append(word)
    if phrase:
        yield tuple(phrase)


def complete(phrase: Sequence[SpokenWord]) -> bool:
    """Nothing more can belong to this phrase, whatever comes."""
    length = sum(len(word.text) + 1 for word in phrase) - 1
    return length >= LONGEST_PHRASE or phrase[-1].text.rstrip("\"')]}")[-1:] in tuple(".!?…")


def cue(phrase: Sequence[SpokenWord], origin: float = 0.0) -> str:
    """A WebVTT cue in which every word but the first has its own time, counted from `origin` seconds."""
    first = max(phrase[0].start - origin, 0.0)
    last = max(phrase[-1].end - origin, first + 0.001)
    text = [_escaped(phrase[0].text)]
    for word in phrase[1:]:
        at = word.start - origin
        # A time inside a cue must lie inside its span.
        text.append((f"<{_stamp(at)}>" if first < at < last else "") + _escaped(word.text))
    return f"{_stamp(first)} --> {_stamp(last)}\n{' '.join(text)}\n\n"


def document(words: Iterable[SpokenWord], origin: float = 0.0) -> str:
    """A whole WebVTT file."""
    return HEADER + "".join(cue(phrase, origin) for phrase in phrases(words))


def _apart(before: SpokenWord, after: SpokenWord) -> bool:
    return before.utterance != after.utterance or after.start - before.end > LONGEST_GAP


def _escaped(text: str) -> str:
    return " ".join(text.split()).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _stamp(seconds: float) -> str:
    milliseconds = round(seconds * 1000)
    return (
        f"{milliseconds // 3_600_000:02d}:{milliseconds // 60_000 % 60:02d}"
        f":{milliseconds // 1000 % 60:02d}.{milliseconds % 1000:03d}"
    )
