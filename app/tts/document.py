"""From the items of an SSML document to clauses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from app.align.dictionary import Lexicon
from app.tts import ssml
from app.tts.clause import Clause, Place, cut
from app.tts.splitting import (
    CLAUSE_PAUSE,
    LONGEST_PIECE,
    NO_PAUSE,
    PARAGRAPH_PAUSE,
    SENTENCE_PAUSE,
    ends_clause,
    split_paragraph,
)
from app.tts.ssml import Bookmark, Break, Said, Style
from app.tts.text import clean, speakable
from app.tts.verbalise import Reading, verbalise

_GLUE = "\N{WORD JOINER}"  # for the spaces inside one thing, so that it is one word

_PAUSES = frozenset(".,;:!?…—()")


@dataclass(slots=True)
class _Token:
    """A word of a document: its parts, of which some are read in their own way."""

    parts: list[Said]

    @property
    def text(self) -> str:
        return "".join(part.text for part in self.parts)

    @property
    def special(self) -> bool:
        return any(part.special for part in self.parts)


class Document:
    """Turns the items of a document into clauses."""

    def __init__(self, own: Lexicon) -> None:
        self._own = own
        self._clauses: list[Clause] = []
        self._unread: list[str] = []
        self._tokens: list[_Token] = []
        self._marks: list[tuple[str, int]] = []  # since the last clause: name, number of the token it stands before
        self._style = Style()
        self._glued = False  # the next text goes on with the last word
        self._broken = False  # a break stands behind the last clause, so its punctuation makes no pause
        self._lead = 0.0
        self._leading: list[Place] = []

    def clauses(self, items: Sequence[ssml.Item]) -> tuple[list[Clause], tuple[str, ...]]:
        for item in items:
            if isinstance(item, Said):
                self._say(item)
            elif isinstance(item, Bookmark):
                self._marks.append((item.name, len(self._tokens)))
            elif isinstance(item, Break):
                self._finish(None)
                self._break(item.seconds)
            else:
                self._finish(PARAGRAPH_PAUSE if item.paragraph else SENTENCE_PAUSE)
        self._finish(SENTENCE_PAUSE)
        self._place_marks()
        if self._clauses and self._clauses[-1].pause > SENTENCE_PAUSE:  # nothing follows the last paragraph
            self._clauses[-1] = replace(self._clauses[-1], pause=SENTENCE_PAUSE)
        return self._clauses, tuple(dict.fromkeys(self._unread))

    def _say(self, item: Said) -> None:
        cleaned = clean(" ".join(item.text.split()), markdown=False)
        self._unread += cleaned.unread
        text = " ".join(cleaned.text.split())
        if item.special:
            alias = clean(item.alias, markdown=False)
            self._unread += alias.unread
            # what has no letter that can be read may still be said: <sub alias="smile">:)</sub>
            item = replace(item, text=(text or _printable(item.text)).replace(" ", _GLUE), alias=alias.text)
            if not item.special:
                return
        elif not text:
            self._glued = self._glued and item.text.strip() != "" and not item.text[:1].isspace()
            return
        if item.style != self._style:
            if self._tokens:
                self._finish(None)
            self._style = item.style
        if item.special:
            self._add(item, glued=self._glued)
            self._glued = True
            return
        glued = self._glued and not item.text[0].isspace()
        for word in text.split():
            for at in range(0, len(word), LONGEST_PIECE):
                self._add(replace(item, text=word[at : at + LONGEST_PIECE]), glued=glued and at == 0)
            glued = False
        self._glued = not item.text[-1].isspace()

    def _add(self, item: Said, *, glued: bool) -> None:
        if glued and self._tokens and len(self._tokens[-1].text) + len(item.text) <= LONGEST_PIECE:
            self._tokens[-1].parts.append(item)
        else:
            self._tokens.append(_Token([item]))

    def _place_marks(self) -> None:
        """Put the marks that wait for a word to where we are: behind the last clause, or before the first."""
        for name, _ in self._marks:
            if self._clauses:
                last = self._clauses[-1]
                place = Place(name, len(last.readings), last.silence)
                self._clauses[-1] = replace(last, marks=(*last.marks, place))
            else:
                self._leading.append(Place(name, -1, self._lead))
        self._marks = []

    def _break(self, seconds: float) -> None:
        self._place_marks()
        if not self._clauses:
            self._lead += seconds
        else:
            last = self._clauses[-1]
            self._clauses[-1] = replace(last, pause=NO_PAUSE, silence=last.silence + seconds)
            self._broken = True

    def _finish(self, pause: float | None) -> None:
        """End the clause; `pause`: what comes after it, None: what its punctuation says."""
        self._glued = False
        tokens, self._tokens = self._tokens, []
        if not tokens:  # marks wait for the next word
            if pause is not None and self._clauses and not self._broken:
                self._clauses[-1] = replace(self._clauses[-1], pause=max(pause, self._clauses[-1].pause))
            return
        marks, self._marks = self._marks, []
        pieces = split_paragraph(" ".join(token.text for token in tokens), first=not self._clauses)
        at = 0
        made: list[Clause] = []
        waiting: list[tuple[str, int]] = []
        for number, piece in enumerate(pieces):
            count = len(piece.text.split())
            mine = tokens[at : at + count]
            last = number == len(pieces) - 1
            here = [
                *waiting,
                *((name, to - at) for name, to in marks if at <= to < at + count or (last and to >= at + count)),
            ]
            at += count
            after = piece.pause
            if last:
                after = pause if pause is not None else _natural(mine[-1].text)
            clauses = list(self._clause(mine, after, here))
            waiting = [] if clauses else [(name, 0) for name, _ in here]
            made += clauses
        if made:
            first = made[0]
            made[0] = replace(first, lead=self._lead, marks=(*self._leading, *first.marks))
            self._lead, self._leading = 0.0, []
            self._clauses += made
            self._broken = False
        self._marks = waiting

    def _clause(self, tokens: Sequence[_Token], pause: float, marks: Sequence[tuple[str, int]]) -> Iterator[Clause]:
        readings: list[Reading] = []
        firsts: list[int] = []  # the reading of each token
        said: dict[int, tuple[str, Sequence[str]]] = {}
        at = 0
        while at < len(tokens):
            if tokens[at].special:
                reading, pronounced = self._special(tokens[at])
                if pronounced:
                    said[len(readings)] = pronounced
                firsts.append(len(readings))
                readings.append(reading)
                at += 1
                continue
            end = next((n for n in range(at, len(tokens)) if tokens[n].special), len(tokens))
            for reading in verbalise(" ".join(token.text for token in tokens[at:end]), own=self._own):
                firsts += [len(readings)] * len(reading.text.split())
                readings.append(reading)
            at = end
        if not any(speakable(reading.spoken) for reading in readings):
            return
        places = tuple(Place(name, firsts[to] if to < len(firsts) else len(readings)) for name, to in marks)
        text = " ".join(token.text.replace(_GLUE, " ") for token in tokens)
        clause = Clause(text, pause, tuple(readings), self._style.speed, self._style.gain, marks=places)
        yield from cut(clause, said)

    def _special(self, token: _Token) -> tuple[Reading, tuple[str, Sequence[str]] | None]:
        """The reading of a word of which some parts are read in their own way."""
        spoken = ""
        pronounced: tuple[str, Sequence[str]] | None = None
        for part in token.parts:
            if part.phones:
                word = "".join(filter(str.isalpha, part.text.casefold())) or "sound"
                if pronounced is None or pronounced == (word, part.phones):
                    pronounced = (word, part.phones)
                said = word
            elif part.alias:
                said = " ".join(filter(None, (reading.spoken for reading in verbalise(part.alias, own=self._own))))
            elif part.spoken:
                said = part.spoken
            elif any(map(str.isalnum, part.text)):
                said = " ".join(filter(None, (reading.spoken for reading in verbalise(part.text, own=self._own))))
            else:
                said = "".join(letter for letter in part.text if letter in _PAUSES)
            joint = "" if not said[:1].isalnum() or not spoken or spoken.endswith(("(", "-")) else " "
            spoken += joint + said
        return Reading(token.text.replace(_GLUE, " "), spoken), pronounced


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() and not letter.isspace() else " " for letter in text).strip() or "?"


def _natural(word: str) -> float:
    """The pause after a word by its punctuation."""
    if word.rstrip("\"')]}")[-1:] in tuple(".!?…"):
        return SENTENCE_PAUSE
    return CLAUSE_PAUSE if ends_clause(word) else NO_PAUSE
