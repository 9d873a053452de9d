"""Splits cleaned text into pieces that are spoken one after the other.

Everything here runs in time linear in the length of the text, whatever the text is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from app.tts.reading.word_list import these
from app.tts.text import speakable

FIRST_PIECE = 60  # characters: the first piece is short so that sound starts early
LONGEST_PIECE = 200  # characters
SHORTEST_CUT = 12  # characters: a first piece shorter than this is not worth a break in the melody

PARAGRAPH_PAUSE = 0.55  # seconds
SENTENCE_PAUSE = 0.30
CLAUSE_PAUSE = 0.12
NO_PAUSE = 0.0


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece of text that is spoken at once, and the silence in seconds after it."""

    text: str
    pause: float


_TITLES = these(
    "mr mrs ms mx dr prof st mt ft gen gov sen rep capt cpt lt col sgt cmdr rev hon pres supt cpl maj adm fr msgr "
    "messrs mmes vs cf approx fig figs vol vols pp ed eds est dept e.g i.e eg ie viz ca"
)
_BEFORE_NUMBER = these("no nos p ch sec art jan feb mar apr jun jul aug sep sept oct nov dec")
_MAYBE_LAST = these("etc inc ltd co corp jr sr ave blvd rd bros univ al a.m p.m am pm ph.d b.a m.a")
_STARTERS = these(
    "the a an he she it they we you i in on at but and so this that these those there here however then when while if "
    "his her its their our my your what who why how where as after before for to no yes let please"
)
_CONJUNCTIONS = these(
    "and but or nor so yet because although though while whereas which who whom whose that when where if unless until "
    "since after before than as"
)
_CLOSERS = "\"')]}"
_OPENERS = "\"'([{"
_DOTTED = re.compile(r"(?:[A-Za-z]\.)+[A-Za-z]?\Z")
_ENUMERATOR = re.compile(r"\(?(?:\d{1,3}|[A-Za-z]|[IVX]{2,6})[.)]\Z")


def split(text: str) -> tuple[Piece, ...]:
    """Split text into the pieces to speak, in order.

    Pieces end where sentences end; a sentence longer than `LONGEST_PIECE` is cut at clause punctuation, else before a
    conjunction, else at a space, else anywhere. The first piece is at most `FIRST_PIECE` characters long where a clause
    boundary allows. No letter and no digit is lost; pieces with nothing to be heard (``...``) are left out.

    Returns:
        no piece if there is nothing to say.
    """
    pieces: list[Piece] = []
    for paragraph in re.split(r"\n[^\S\n]*\n", text):
        pieces += (piece for piece in split_paragraph(paragraph, first=not pieces) if speakable(piece.text))
        if pieces:
            pieces[-1] = Piece(pieces[-1].text, max(pieces[-1].pause, PARAGRAPH_PAUSE))
    if pieces and pieces[-1].pause > SENTENCE_PAUSE:  # nothing follows the last paragraph
        pieces[-1] = Piece(pieces[-1].text, SENTENCE_PAUSE)
    return tuple(pieces)


def split_paragraph(paragraph: str, *, first: bool) -> tuple[Piece, ...]:
    """The pieces of a paragraph with all its words, heard or not; `first`: the first one is short, if it can be."""
    pieces: list[Piece] = []
    for sentence, pause in _sentences(paragraph):
        cuts = _cuts(sentence, LONGEST_PIECE, first=first)
        for at, piece in enumerate(cuts):
            joined = " ".join(piece)
            between = CLAUSE_PAUSE if ends_clause(piece[-1]) else NO_PAUSE
            pieces.append(Piece(joined, pause if at == len(cuts) - 1 else between))
            first = first and not speakable(joined)
    return tuple(pieces)


def _sentences(paragraph: str) -> Iterator[tuple[list[str], float]]:
    """The words of each sentence of a paragraph, and the pause after it."""
    sentence: list[str] = []
    lines = [words for line in paragraph.splitlines() if (words := _words(line))]
    for number, line in enumerate(lines):
        for at, word in enumerate(line):
            sentence.append(word)
            if at + 1 < len(line):
                if ends_sentence(word, line[at + 1], len(sentence) == 1):
                    yield sentence, SENTENCE_PAUSE
                    sentence = []
            elif number + 1 < len(lines):
                following = lines[number + 1][0]
                if ends_sentence(word, following, len(sentence) == 1):
                    yield sentence, SENTENCE_PAUSE
                    sentence = []
                elif not following.lstrip(_OPENERS)[:1].islower():  # a list, a poem, a title: not a wrapped line
                    yield sentence, SENTENCE_PAUSE if _stop(word) else CLAUSE_PAUSE
                    sentence = []
    if sentence:
        yield sentence, SENTENCE_PAUSE


def _words(line: str) -> list[str]:
    return [
        word[at : at + LONGEST_PIECE]  # a "word" longer than a piece is cut blindly
        for word in line.split()
        for at in range(0, len(word), LONGEST_PIECE)
    ]


def _stop(word: str) -> str:
    """The sentence punctuation at the end of a word, without closing quotes: ``.``, ``...``, ``!`` ... or nothing."""
    bare = word.rstrip(_CLOSERS)
    return bare[len(bare.rstrip(".!?…")) :]


def ends_sentence(word: str, following: str, first: bool) -> bool:
    """Whether a sentence ends with `word`; of the following word the beginning will do. `first`: it begins one, too."""
    stop = _stop(word)
    if not stop:
        return False
    after = following.lstrip(_OPENERS)
    if after[:1].islower():  # "Really?" she said. Wait ... what?
        return False
    if stop != ".":
        return True
    closed = word[-1] in _CLOSERS
    core = word.rstrip(_CLOSERS)[:-1].lstrip(_OPENERS)
    lowered = core.lower()
    starter = re.sub(r"\W.*", "", after).lower() in _STARTERS and after[:1].isupper()
    if closed and word.rstrip(_CLOSERS)[-1] == "." and word[-1] in "\"'":
        return True
    if first and _ENUMERATOR.match(core + "."):  # 1. First point
        return False
    if lowered in _TITLES:
        return False
    if lowered in _BEFORE_NUMBER:
        return not after[:1].isdigit()
    if lowered in _MAYBE_LAST or _DOTTED.match(core + ".") or (len(core) == 1 and core.isupper()):
        return starter
    return True


def ends_clause(word: str) -> bool:
    """Whether one can pause after `word`."""
    return word.rstrip(_CLOSERS)[-1:] in ",;:—" or word.endswith(")")


def _cuts(words: Sequence[str], longest: int, *, first: bool) -> list[Sequence[str]]:
    """Cut a sentence into pieces of at most `longest` characters, the first also short if `first`."""
    pieces: list[Sequence[str]] = []
    start = 0
    if first and (size := _short_start(words)):
        pieces.append(words[:size])
        start = size
    while start < len(words):
        size = _fitting(words, start, longest)
        if start + size < len(words):
            size = _best_cut(words, start, size)
        pieces.append(words[start : start + size])
        start += size
    return pieces


def _fitting(words: Sequence[str], start: int, longest: int) -> int:
    """How many words from `start` fit into `longest` characters; at least one."""
    length = size = 0
    for at in range(start, len(words)):
        length += len(words[at]) + (at > start)
        if length > longest and size:
            break
        size += 1
    return size


def _best_cut(words: Sequence[str], start: int, size: int) -> int:
    """The best number of words, up to `size`, for a piece that must end before the sentence does."""
    least = max(1, size // 3)
    for strong in (";:—", ",;:—"):
        for at in range(size, least, -1):
            if words[start + at - 1].rstrip(_CLOSERS)[-1:] in tuple(strong):
                return at
    for at in range(size, least, -1):
        if words[start + at].lower() in _CONJUNCTIONS:
            return at
    return size


def _short_start(words: Sequence[str]) -> int:
    """How many words make a short first piece; 0 if the sentence is short itself or has no clause boundary early on."""
    if len(" ".join(words[: FIRST_PIECE + 1])) <= FIRST_PIECE:
        return 0
    length, best = 0, 0
    for at, word in enumerate(words[:-1]):
        length += len(word) + (at > 0)
        if length > FIRST_PIECE:
            break
        if length >= SHORTEST_CUT and ends_clause(word):
            best = at + 1
    return best
