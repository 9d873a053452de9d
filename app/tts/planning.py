"""What will be said: a text or SSML as clauses, each with its words as they are written and as they are spoken."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from app.align.dictionary import NO_LEXICON, Dictionary, Lexicon, folded, read_lexicon
from app.errors import NothingToSay
from app.tts import ssml
from app.tts.clause import Clause, cut
from app.tts.document import Document
from app.tts.splitting import split
from app.tts.text import clean
from app.tts.verbalise import verbalise

Markup = Literal["auto", "text", "ssml"]

_SSML = re.compile(
    r"[\ufeff\s]*(?:<\?xml\s.{0,200}?\?>\s*)?(?><!--.{0,2000}?-->\s*)*+(?:<!DOCTYPE\s+\S|<(?:ssml:)?speak\b)", re.DOTALL
)
"""How an SSML document begins: a document type, too, which `app.tts.ssml` refuses, is not to be read aloud."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What will be said.

    Attributes:
        clauses: the pieces to speak, at least one.
        unread: what of the text cannot be read.
        guessed: words, each once as they are written, that neither the lexicon nor the dictionary has.
        lexicon: how some of the words are to be said.
    """

    clauses: tuple[Clause, ...]
    unread: tuple[str, ...]
    guessed: tuple[str, ...] = ()
    lexicon: Lexicon = field(default_factory=lambda: NO_LEXICON)


def plan(text: str, *, markup: Markup = "auto", lexicon: Mapping[str, str | Sequence[str]] = NO_LEXICON) -> Plan:
    """Clean, split and read a text without speaking it; quick enough for the request that brings the text.

    Args:
        text: any, or SSML.
        markup: what it is; "auto" takes it for SSML if it begins with ``<speak``, after an XML
            declaration, comments or a document type perhaps.
        lexicon: see `app.align.dictionary.read_lexicon`.

    Raises:
        NothingToSay: no readable text.
        InputError: the lexicon has a pronunciation that is none, or the SSML is wrong.
    """
    own = read_lexicon(lexicon) if lexicon else NO_LEXICON
    if markup == "ssml" or (markup == "auto" and _SSML.match(text)):
        clauses, unread = Document(own).clauses(ssml.parse(text))
    else:
        clauses, unread = _plain(text, own)
    if not clauses:
        raise nothing(unread)
    return Plan(tuple(clauses), unread, _guessed(clauses, own), own)


def nothing(unread: Sequence[str]) -> NothingToSay:
    """The error for a text with nothing to be said."""
    found = f"; {', '.join(unread)[:80]} cannot be read" if unread else ""
    return NothingToSay(f"the text has nothing to say{found}", field="text", advice="Send some words in Latin letters.")


def _plain(text: str, own: Lexicon) -> tuple[list[Clause], tuple[str, ...]]:
    cleaned = clean(text)
    clauses: list[Clause] = []
    for piece in split(cleaned.text):
        clauses += cut(Clause(piece.text, piece.pause, verbalise(piece.text, own=own)))
    return clauses, cleaned.unread


def _guessed(clauses: Sequence[Clause], own: Lexicon) -> tuple[str, ...]:
    dictionary = Dictionary().with_lexicon(own)
    spoken: dict[str, str] = {}
    for clause in clauses:
        for reading in clause.readings:
            if reading.as_written:
                spoken.setdefault(reading.spoken, reading.text)
    words: dict[str, str] = {}
    for said, written in spoken.items():
        words.setdefault(folded(said), written)
    return tuple(_bare(written) for word, written in words.items() if not dictionary.knows(word))


def _bare(written: str) -> str:
    """A written word without the punctuation around it."""
    start, end = 0, len(written)
    while start < end and not written[start].isalnum():
        start += 1
    while end > start and not written[end - 1].isalnum():
        end -= 1
    return written[start:end]
