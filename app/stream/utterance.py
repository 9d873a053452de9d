"""One thing to say: its text's pieces on their way to the stream, and what became of it."""

from __future__ import annotations

import secrets
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from app.errors import MaryError
from app.speech import Speech
from app.stream.clock import FPS
from app.stream.narration import Narration
from app.stream.pieces import Piece
from app.stream.recording import Recording
from app.stream.timeline import IdlePhase
from app.stream.timing import Stage, UtteranceTimings

if TYPE_CHECKING:
    from app.engine.avatar import Avatar

UtteranceState = Literal["queued", "speaking", "done", "interrupted", "failed"]


@dataclass(frozen=True, slots=True)
class Script:
    """A text that has been checked.

    Attributes:
        speeches: makes the speech piece by piece when it is iterated; that blocks, and may raise `MaryError`. None says
            that there is nothing yet, and is to come within a moment.
        unread: what of the text cannot be read.
        guessed: words of the text that no dictionary has.
    """

    speeches: Iterator[Speech | None]
    unread: tuple[str, ...] = ()
    guessed: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Reading:
    """How a text is to be read.

    Attributes:
        voice: to speak with; empty: the stream's.
        speed: 1 = the voice's own pace.
        lexicon: word to ARPAbet, for words that would be said otherwise.
        strict: refuse words whose pronunciation had to be guessed.
        markup: whether the text is SSML; "auto" looks at how it begins.
    """

    voice: str = ""
    speed: float = 1.0
    lexicon: Mapping[str, str] = field(default_factory=dict)
    strict: bool = False
    markup: Literal["auto", "text", "ssml"] = "auto"


Narrator = Callable[[str, Reading], Script]
"""Text, how to read it -> Script. Quick; raises NothingToSay, InputError or NotFound (voice)."""


@dataclass(frozen=True, slots=True)
class UtteranceReport:
    """An utterance as the outside sees it. `media`: start and end in seconds of the stream, None before it is spoken;
    `end` is None while it is spoken."""

    id: str
    state: UtteranceState
    characters: int
    unread: tuple[str, ...]
    guessed: tuple[str, ...]
    media: tuple[float, float | None] | None
    timings: dict[Stage, float]
    error: str


def _nothing() -> Iterator[Piece | None]:
    return iter(())


@dataclass(eq=False)
class Utterance:
    """What `LiveStream.say` returns. Frames are those of the stream's clock.

    Attributes:
        characters: length of the text, which itself is not kept.
        unread: what of it cannot be read.
        guessed: words of it that no dictionary has.
        phase: where the page's idle clip was when it was asked for.
        id: 128 random bits.
        state: "queued" until its first frame has its place, "speaking" until the clock has passed its last one.
        timings: milliseconds from the request to each stage.
        recording: its file, from the first frame on.
        start: its first frame, None before it is spoken.
        end: the frame after its last, None before that is known.
        error: why it failed, for the caller to read.
        received: when it was asked for, seconds on the monotonic clock.
        narration: makes its pieces, once its turn has come.
        make: what the narration runs.
        face: draws it; None: the stream's avatar as it is.
        last: the frame after those placed so far.
        base: the frame its pieces count from: `start` and all delays since.
        ready: pieces made and not placed, at most `PIECES_AHEAD`.
        narrated: no more pieces will come.
    """

    characters: int
    unread: tuple[str, ...] = ()
    guessed: tuple[str, ...] = ()
    phase: IdlePhase | None = None
    id: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    state: UtteranceState = "queued"
    timings: UtteranceTimings = field(default_factory=UtteranceTimings)
    recording: Recording | None = None
    start: int | None = None
    end: int | None = None
    error: str = ""
    received: float = field(default_factory=time.monotonic)
    narration: Narration | None = None
    make: Callable[[], Iterator[Piece | None]] = field(default=_nothing)
    face: Avatar | None = None
    last: int = 0
    base: int = 0
    ready: deque[Piece] = field(default_factory=deque)
    narrated: bool = False

    @property
    def finished(self) -> bool:
        """It is neither waiting nor being spoken."""
        return self.state in ("done", "interrupted", "failed")

    def fail(self, error: BaseException) -> None:
        """Its speech cannot be made; the message is for the caller to read."""
        self.error = error.message if isinstance(error, MaryError) else f"{type(error).__name__}: {error}"
        self.narrated = True

    def finish(self, state: Literal["done", "interrupted", "failed"]) -> None:
        """It is over; what made it is let go, what became of it stays."""
        self.cancel()
        self.state = state
        self.narration, self.make = None, _nothing

    def cancel(self) -> None:
        """Make no more pieces and forget those not placed."""
        if self.narration is not None:
            self.narration.cancel()
        self.ready.clear()
        self.narrated = True

    def report(self) -> UtteranceReport:
        """A copy for the outside."""
        media = None
        if self.start is not None:
            media = (self.start / FPS, None if self.end is None else self.end / FPS)
        timings = self.timings.milliseconds()
        return UtteranceReport(
            self.id, self.state, self.characters, self.unread, self.guessed, media, timings, self.error
        )
