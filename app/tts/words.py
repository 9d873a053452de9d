"""Which of the words that are heard say which of the words that are written."""

from __future__ import annotations

import difflib
from collections.abc import Sequence


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


def _bare(word: str) -> str:
    return "".join(letter for letter in word.lower() if letter.isalnum())
