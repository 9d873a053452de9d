"""Speaks a text while it is still being written: the tokens of a language model, or somebody typing.

What has come is spoken as soon as a clause is known to be complete, so speech begins long before the text ends, and
silence is kept where the writer is slower than the voice.
"""

from __future__ import annotations

import itertools
import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

from app.align.dictionary import NO_LEXICON, read_lexicon
from app.errors import Gone, NothingToSay, OverCapacity
from app.speech import Speech
from app.tts.engine import SpeechEngine
from app.tts.narrate import check_speed, speak
from app.tts.planning import Plan, plan
from app.tts.splitting import CLAUSE_PAUSE, LONGEST_PIECE, SHORTEST_CUT, ends_clause, ends_sentence
from app.tts.text import clean

HOLD_SENTENCE = 0.2
"""Seconds after which a full stop ends a sentence though nothing follows it: "3." may go on as "3.5"."""
HOLD_WORDS = 2.0
"""Seconds without anything new after which what is there is spoken, whatever it is."""
ASK_SECONDS = 0.1


class LiveText:
    """A text in the making, and the speech of it. Safe from any thread; one thread iterates `speeches`.

    Args:
        engine: speaks.
        voice: its voice.
        speed: 0.5 to 2.
        limit: characters that may wait to be spoken.
        lexicon: how some words are to be said, see `app.align.dictionary.read_lexicon`.
        clock: seconds, monotonic.
        wait: how long `speeches` waits before it says that there is nothing yet.

    Attributes:
        characters: written so far.
        unread: what of the text could not be read so far, each run once.

    Raises:
        InputError: speed out of range, or the lexicon has a pronunciation that is none.
    """

    def __init__(
        self,
        engine: SpeechEngine,
        *,
        voice: str,
        speed: float = 1.0,
        limit: int = 10_000,
        lexicon: Mapping[str, str | Sequence[str]] = NO_LEXICON,
        clock: Callable[[], float] = time.monotonic,
        wait: float = ASK_SECONDS,
    ) -> None:
        check_speed(speed)
        self.characters = 0
        self.unread: tuple[str, ...] = ()
        self._engine, self._voice, self._speed = engine, voice, speed
        self._limit = limit
        self._lexicon = read_lexicon(lexicon)
        self._clock = clock
        self._wait = wait
        self._changed = threading.Condition()
        self._text = ""
        self._written_at = clock()
        self._flushed = 0  # characters of `_text` that are to be spoken as they are
        self._ended = False

    def push(self, text: str) -> None:
        """More of the text, in pieces of any size.

        Raises:
            Gone: `end` has been called.
            OverCapacity: more would wait than `limit`; nothing of `text` is taken.
        """
        with self._changed:
            if self._ended:
                raise Gone("this text has ended", advice="Begin another one.")
            if len(self._text) + len(text) > self._limit:
                raise OverCapacity(
                    f"{len(self._text):,} characters wait to be spoken, more than {self._limit:,} are not kept",
                    advice="Write slower, or interrupt.",
                    field="text",
                )
            self._text += text
            self.characters += len(text)
            self._written_at = self._clock()
            self._changed.notify()

    def flush(self) -> None:
        """What has been written is to be spoken without waiting for the end of its clause."""
        with self._changed:
            self._flushed = len(self._text)
            self._changed.notify()

    def end(self) -> None:
        """Nothing follows. May be called again."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def speeches(self) -> Iterator[Speech | None]:
        """The speech, a piece at a time, as in `narrate`; None when there has been nothing to say for a moment.

        Raises:
            NothingToSay: at the end, if nothing was readable.
            SpeechFailed: the engine failed or made unsound speech.
        """
        spoken = False
        while True:
            written = self._take()
            if written is None:
                break
            if not written:
                yield None
                continue
            planned = self._plan(written)
            if planned is None:
                continue
            for speech in speak(self._engine, planned, voice=self._voice, speed=self._speed):
                spoken = True
                yield speech
        if not spoken:
            raise NothingToSay("nothing that can be read was written", field="text")

    def _plan(self, written: str) -> Plan | None:
        try:
            planned = plan(written, markup="text", lexicon=self._lexicon)
        except NothingToSay:
            self._remember_unread(clean(written).unread)
            return None
        self._remember_unread(planned.unread)
        *clauses, last = planned.clauses
        if ends_clause(last.text.split()[-1]):  # a sentence that goes on
            last = replace(last, pause=CLAUSE_PAUSE)
        return replace(planned, clauses=(*clauses, last), unread=())

    def _remember_unread(self, unread: tuple[str, ...]) -> None:
        self.unread = tuple(dict.fromkeys((*self.unread, *unread)))

    def _take(self) -> str | None:
        """The next text to speak; empty if there is none yet, None if there will be none."""
        with self._changed:
            if not self._complete() and not self._ended:
                self._changed.wait(self._wait)
            size = self._complete()
            if not size and self._ended:
                size = len(self._text)
                if not size:
                    return None
            taken, self._text = self._text[:size], self._text[size:]
            self._flushed = max(0, self._flushed - size)
            return taken

    def _complete(self) -> int:
        if self._flushed:
            return self._flushed
        waited = self._clock() - self._written_at
        if waited >= HOLD_WORDS or (waited >= HOLD_SENTENCE and self._text.rstrip()[-1:] in tuple(".!?…")):
            return len(self._text)
        return complete(self._text)


def complete(text: str) -> int:
    """How many characters of a growing text can be spoken: whole sentences if there are any, else whole clauses.

    The last word does not count, since it may go on, and neither does a full stop without the beginning of what
    follows, by which it is known whether it ends a sentence. A text without any boundary is cut when it is as long as a
    piece may be.
    """
    words = list(_WORD.finditer(text))
    sentence = clause = 0
    first = True
    for word, following in itertools.pairwise(words):
        end = word.end("word")
        if word["gap"].count("\n") > 1 or ends_sentence(word["word"], following["word"], first):
            sentence, first = end, True
            continue
        first = False
        if end >= SHORTEST_CUT and ends_clause(word["word"]):
            clause = end
    if sentence or clause:
        return sentence or clause
    if len(text) <= LONGEST_PIECE:
        return 0
    return words[-2].end("word") if len(words) > 1 else len(text)


_WORD = re.compile(r"(?P<word>\S+)(?P<gap>\s*)")
