"""Sets of words, written the short way."""

from __future__ import annotations


def these(words: str) -> frozenset[str]:
    """The words of a text as a set."""
    return frozenset(words.split())
