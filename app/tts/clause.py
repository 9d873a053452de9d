"""A clause: what an engine is asked to say at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from app.align.dictionary import NO_LEXICON, Lexicon, folded
from app.tts.splitting import NO_PAUSE
from app.tts.verbalise import Reading

LONGEST_SPOKEN = 400  # characters of spoken text in a clause: "1,1,1,1" grows a lot


@dataclass(frozen=True, slots=True)
class Place:
    """A mark in a clause.

    Attributes:
        name: its own.
        reading: number of the reading at whose beginning it stands; -1: the clause's beginning; their number: its end.
        after: seconds behind that beginning or end.
    """

    name: str
    reading: int
    after: float = 0.0


@dataclass(frozen=True, slots=True)
class Clause:
    """A piece of text that is spoken at once.

    Attributes:
        text: as it is written.
        pause: seconds of silence after it at speed 1.
        readings: its words and what is said for them.
        speed: so many times as fast as the rest.
        gain: decibels.
        lexicon: how words of this clause are said, before the plan's.
        marks: in order.
        lead: seconds of silence before it, at any speed.
        silence: seconds of silence after it besides `pause`, at any speed.
    """

    text: str
    pause: float
    readings: tuple[Reading, ...]
    speed: float = 1.0
    gain: float = 0.0
    lexicon: Lexicon = field(default_factory=lambda: NO_LEXICON)
    marks: tuple[Place, ...] = ()
    lead: float = 0.0
    silence: float = 0.0

    @property
    def spoken(self) -> str:
        """What an engine is to say."""
        return " ".join(reading.spoken for reading in self.readings if reading.spoken)


def cut(clause: Clause, said: Mapping[int, tuple[str, Sequence[str]]] | None = None) -> Iterator[Clause]:
    """A clause in several if it is too long when spoken, or if a word would have to be said in two ways.

    Args:
        said: by reading, a spoken word and its phones.
    """
    special = said or {}
    starts = [0]
    length = 0
    ways: dict[str, Sequence[str] | None] = {}
    for at, reading in enumerate(clause.readings):
        length += len(reading.spoken) + 1
        if at in special:
            here: dict[str, Sequence[str] | None] = {special[at][0]: special[at][1]}
        else:
            here = {folded(word): None for word in reading.spoken.split()} if special else {}
        if (length > LONGEST_SPOKEN and at > starts[-1]) or any(
            ways.get(word, way) != way for word, way in here.items()
        ):
            starts.append(at)
            length, ways = len(reading.spoken) + 1, {}
        ways |= here
    for start, end in zip(starts, [*starts[1:], len(clause.readings)], strict=True):
        readings = clause.readings[start:end]
        last = end == len(clause.readings)
        yield replace(
            clause,
            text=clause.text if len(starts) == 1 else " ".join(reading.text for reading in readings),
            readings=readings,
            lexicon={special[at][0]: tuple(special[at][1]) for at in range(start, end) if at in special} or NO_LEXICON,
            marks=tuple(
                replace(mark, reading=mark.reading - start)
                for mark in clause.marks
                if start <= mark.reading < end or (last and mark.reading >= end)
            ),
            pause=clause.pause if last else NO_PAUSE,
        )
