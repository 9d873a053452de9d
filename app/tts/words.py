"""Which of the words that are heard say which of the words that are written."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence

from app.speech import Word


def assign(spoken: Sequence[str], expected: Sequence[Sequence[str]]) -> list[range]:
    """Which spoken words say each written word.

    A sentence is read otherwise than its words one by one ("10:30 pm", "Jan. 5th", "$3 million"), so the two readings
    are laid side by side: what is equal belongs together; what lies between is divided in order, one for one if the
    numbers agree, else in proportion.

    Args:
        spoken: the words of the sentence as it is read.
        expected: for each written word, the words it would be read as by itself.

    Returns:
        for each written word a range of spoken words, in order, not overlapping, together all of them unless no word is
        written; a word that is not said has an empty range.
    """
    owners = [number for number, words in enumerate(expected) for _ in words]
    flat = [_bare(word) for words in expected for word in words]
    heard = [_bare(word) for word in spoken]
    owned: list[int] = []  # the written word of each spoken word so far
    if flat == heard:
        owned = list(owners)
    else:
        matcher = difflib.SequenceMatcher(None, flat, heard, autojunk=False)
        for tag, from_flat, to_flat, from_heard, to_heard in matcher.get_opcodes():
            count = to_heard - from_heard
            if tag == "equal":
                owned += owners[from_flat:to_flat]
            elif count and to_flat > from_flat:
                owned += [owners[from_flat + at * (to_flat - from_flat) // count] for at in range(count)]
            elif count and owners:  # said without being expected: it goes with the word before
                owned += [owned[-1] if owned else owners[0]] * count
    spans: list[range] = []
    at = 0
    for number in range(len(expected)):
        start = at
        while at < len(owned) and owned[at] == number:
            at += 1
        spans.append(range(start, at))
    return spans


def as_written(heard: Sequence[Word], readings: Sequence[str]) -> list[Word | None]:
    """When each written word sounds, given when the spoken words do.

    Engines drop words, join them ("thankyou") and write them otherwise. What is equal belongs together; where the words
    differ, their time is divided between the written ones by their letters.

    Args:
        heard: words with times, in order, as an engine gives them.
        readings: for each written word what is said for it.

    Returns:
        for each written word its times, its text being what was to be said; None if nothing of it is heard.
    """
    said = [word for word in heard for word in _single(word)]
    owners = [number for number, reading in enumerate(readings) for word in reading.split() if _bare(word)]
    flat = [bare for reading in readings for word in reading.split() if (bare := _bare(word))]
    plain = [_bare(word.text) for word in said]
    spans: list[tuple[float, float] | None] = [None] * len(flat)
    if flat == plain:
        spans = [(word.start, word.end) for word in said]
    else:
        matcher = difflib.SequenceMatcher(None, flat, plain, autojunk=False)
        for tag, start, stop, first, last in matcher.get_opcodes():
            if tag == "equal":
                spans[start:stop] = [(word.start, word.end) for word in said[first:last]]
            elif tag == "replace":
                spans[start:stop] = _divided(flat[start:stop], plain[first:last], said[first:last])
            elif tag == "insert" and start and (before := spans[start - 1]) is not None:
                spans[start - 1] = (before[0], said[last - 1].end)
    times: list[Word | None] = [None] * len(readings)
    for owner, span in zip(owners, spans, strict=True):
        if span is not None:
            word = times[owner]
            times[owner] = Word(readings[owner], span[0] if word is None else word.start, span[1])
    return times


def _single(word: Word) -> Iterator[Word]:
    """A word that is several, divided by their letters; words without a letter are left out."""
    parts = [part for part in word.text.split() if _bare(part)]
    total = sum(len(_bare(part)) for part in parts)
    done = 0
    for part in parts:
        start = word.start + (word.end - word.start) * done / total
        done += len(_bare(part))
        yield Word(part, start, word.start + (word.end - word.start) * done / total)


def _divided(flat: Sequence[str], plain: Sequence[str], said: Sequence[Word]) -> list[tuple[float, float] | None]:
    """The time of some heard words divided between other words: as far into the letters, as far into the time."""
    edges, times, count = [0.0], [said[0].start], 0
    for letters, word in zip(plain, said, strict=True):
        edges += [float(count), float(count + len(letters))]
        times += [word.start, word.end]
        count += len(letters)
    share = count / sum(map(len, flat))
    spans: list[tuple[float, float] | None] = []
    done = 0.0
    for letters in flat:
        start, done = done, done + len(letters) * share
        spans.append((_at(start, edges, times, after=True), _at(done, edges, times, after=False)))
    return spans


def _at(position: float, edges: Sequence[float], times: Sequence[float], *, after: bool) -> float:
    """The time at a position among letters; at the border of two words the later or the earlier of its times."""
    nearest = min(range(len(edges)), key=lambda at: abs(edges[at] - position))
    if abs(edges[nearest] - position) < 1e-6:
        same = [time for edge, time in zip(edges, times, strict=True) if abs(edge - edges[nearest]) < 1e-6]
        return max(same) if after else min(same)
    right = next((at for at, edge in enumerate(edges) if edge > position), len(edges) - 1)
    span = edges[right] - edges[right - 1]
    share = (position - edges[right - 1]) / span if span else 1.0
    return times[right - 1] + (times[right] - times[right - 1]) * min(share, 1.0)


def _bare(word: str) -> str:
    return "".join(letter for letter in word.lower() if letter.isalnum())


def parts(written: str) -> tuple[str, str, str]:
    """What stands before a written word, the word itself, and what stands after it: ``("(``, ``wait``, ``!)")``."""
    letters = [at for at, letter in enumerate(written) if letter.isalnum()]
    if not letters:
        return written, "", ""
    start, end = letters[0], letters[-1] + 1
    return written[:start], written[start:end], written[end:]
