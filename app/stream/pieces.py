"""Speech, piece by piece, brought to the grid of a stream: 48 kHz sound, and a mouth for every frame.

Pieces come one after the other and are as long as they are, so a piece hardly ever begins on a frame. What is counted
is the time of the whole utterance: frame n shows what sounds n / fps after its start, over any number of pieces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.engine.models.sound import Sound
from app.speech import SILENCE, Mark, Phone, Speech, Word
from app.stream.clock import FPS, FRAME_SAMPLES, SAMPLE_RATE, first_frame_at
from app.stream.soundtrack import Samples, resample
from app.stream.timing import Stage

REST_FRAMES = 5
"""0.2 s of silence after the last word, in which the mouth comes to rest."""
AFTER_FRAMES = 8
"""Frames after a piece that its trajectory is drawn to, if it is known what comes."""
JOIN_FRAMES = 5
"""A piece that follows something else than it was made to follow gets there within so many frames."""
HISTORY_FRAMES = 8
"""Frames before a piece that its trajectory is continued from."""

HEARD_SECONDS = 0.5
"""Of sound before a piece that its trajectory model hears, too."""

Coefficients = NDArray[np.float32]


class Articulator(Protocol):
    """What is needed of an avatar here (see `app.engine.avatar.Avatar`)."""

    @property
    def rest(self) -> Coefficients: ...

    def trajectory(
        self,
        phones: Sequence[Phone],
        frames: int,
        *,
        before: Coefficients | None = None,
        sound: Sound | None = None,
        recognised: bool = False,
    ) -> Coefficients: ...


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece of an utterance, ready to be heard and shown. Samples and frames count from the utterance's start.

    Attributes:
        sample: its first sample.
        samples: 48 kHz mono, float32, shape (n,).
        frame: its first frame, the first one not before `sample`.
        coefficients: one row a frame, shape (frames, K); the next piece's first frame is `frame + frames`.
        follows: the mouth that its first frame continues, shape (K,); None = whatever is shown.
        phones, words, marks: what sounds in it, in seconds from the utterance's start.
    """

    sample: int
    samples: Samples
    frame: int
    coefficients: Coefficients
    follows: Coefficients | None = None
    phones: tuple[Phone, ...] = ()
    words: tuple[Word, ...] = ()
    marks: tuple[Mark, ...] = ()


def pieces(
    articulator: Articulator, speeches: Iterable[Speech | None], mark: Callable[[Stage], None] = lambda _stage: None
) -> Iterator[Piece | None]:
    """Turn speech into pieces, one for each and a last one in which the mouth comes to rest.

    Args:
        articulator: the avatar.
        speeches: they follow each other without a gap; taken one by one as the pieces are. None says that there is
            nothing yet (a text that is still being written), and is handed on.
        mark: told when the stages "speech" and "trajectory" are reached.
    """
    elapsed = Fraction(0)  # seconds; exact, so that nothing adds up
    before = np.repeat(articulator.rest[None], HISTORY_FRAMES, axis=0)
    heard: Sound | None = None
    end = 0
    for speech in speeches:
        if speech is None:
            yield None
            continue
        mark("speech")
        start = end
        elapsed += Fraction(len(speech.samples), speech.rate)
        end = round(elapsed * SAMPLE_RATE)
        first, frames = first_frame_at(start), first_frame_at(end) - first_frame_at(start)
        rows = before[:0]
        if frames:
            offset = (first * FRAME_SAMPLES - start) / SAMPLE_RATE
            rows = _trajectory(articulator, speech, offset, frames, before, _after(heard, speech, offset))
        follows = before[-1]
        before = np.concatenate([before, rows])[-HISTORY_FRAMES:]
        heard = _end_of(speech, heard)
        mark("trajectory")
        samples = resample(speech.samples, speech.rate, end - start)
        yield Piece(start, samples, first, rows, follows, *_since_start(speech, start / SAMPLE_RATE))
    if end:
        first = first_frame_at(end)
        last = (first + REST_FRAMES) * FRAME_SAMPLES
        quiet = Phone(SILENCE, end / SAMPLE_RATE, last / SAMPLE_RATE)
        rows = to_rest(articulator, REST_FRAMES, before)
        yield Piece(end, np.zeros(last - end, np.float32), first, rows, before[-1], (quiet,))


def joined(piece: Piece, shown: Coefficients) -> Coefficients:
    """The mouths of a piece that follows `shown`, shape (K,), which may be another one than it was made to follow.

    A piece that comes late finds the mouth closed meanwhile. Its first mouths are mixed with the one shown, so that
    they overshoot neither.
    """
    rows = piece.coefficients
    if piece.follows is None or not len(rows) or np.array_equal(shown, piece.follows):
        return rows
    mixed = rows.copy()
    share = np.linspace(1, 0, JOIN_FRAMES + 2, dtype=np.float32)[1:-1, None][: len(rows)]
    mixed[: len(share)] += share * (shown - rows[: len(share)])
    return mixed


def to_rest(articulator: Articulator, frames: int, before: Coefficients) -> Coefficients:
    """A mouth that comes to rest within so many frames, from where it is and as fast as it moves; shape (frames, K).

    A cubic whose speed at the end is zero, and which does not go beyond rest. (The trajectory of a short silence closes
    the mouth within a frame, since nothing that comes after asks for less.)

    Args:
        articulator: the avatar.
        frames: how many.
        before: the mouths of the frames before, two or more, shape (b, K).
    """
    t = (np.arange(1, frames + 1, dtype=np.float32) / frames)[:, None]
    start, speed = before[-1] - articulator.rest, (before[-1] - before[-2]) * frames
    speed = np.clip(
        speed, -3 * np.abs(start), 3 * np.abs(start)
    )  # faster, a cubic overshoots (Fritsch and Carlson 1980)
    rows: Coefficients = articulator.rest + (1 - t) ** 2 * ((1 + 2 * t) * start + t * speed)
    return rows


def _since_start(speech: Speech, start: float) -> tuple[tuple[Phone, ...], tuple[Word, ...], tuple[Mark, ...]]:
    return (
        tuple(Phone(phone.symbol, start + phone.start, start + phone.end) for phone in speech.phones),
        tuple(Word(word.text, start + word.start, start + word.end) for word in speech.words),
        tuple(Mark(mark.name, start + mark.time) for mark in speech.marks),
    )


def _trajectory(
    articulator: Articulator, speech: Speech, offset: float, frames: int, before: Coefficients, sound: Sound
) -> Coefficients:
    """Mouths of the frames of one piece, the first of them `offset` seconds after its first sample."""
    if not speech.around:
        phones = _later(speech.phones, offset)
        return articulator.trajectory(phones, frames, before=before, sound=sound, recognised=speech.recognised)
    phones = [Phone(phone.symbol, phone.start - offset, phone.end - offset) for phone in speech.around]
    known = max(0, math.ceil((phones[-1].end - frames / FPS) * FPS))  # frames after the piece draw the mouth already
    more = frames + min(known, AFTER_FRAMES)
    return articulator.trajectory(phones, more, before=before, sound=sound, recognised=speech.recognised)[:frames]


def _after(heard: Sound | None, speech: Speech, offset: float) -> Sound:
    """The sound of a piece with what was heard before it and what is known to follow.

    Live sound is cut in the middle of words, and what a model hears reaches over the cuts.

    Args:
        heard: of the piece before.
        speech: the piece.
        offset: seconds from its first sample to frame 0.
    """
    known = speech.samples if speech.ahead is None else np.concatenate([speech.samples, speech.ahead])
    if heard is None or heard.rate != speech.rate:
        return Sound(known, speech.rate, -offset)
    return Sound(np.concatenate([heard.samples, known]), speech.rate, -offset - len(heard.samples) / speech.rate)


def _end_of(speech: Speech, heard: Sound | None) -> Sound:
    """The last `HEARD_SECONDS` of what has been heard."""
    before = heard.samples if heard is not None and heard.rate == speech.rate else speech.samples[:0]
    return Sound(np.concatenate([before, speech.samples])[-round(HEARD_SECONDS * speech.rate) :], speech.rate)


def _later(phones: Sequence[Phone], offset: float) -> list[Phone]:
    # The same phones on a time axis that begins `offset` seconds later: at the piece's first frame.
    return [Phone(p.symbol, max(0.0, p.start - offset), p.end - offset) for p in phones if p.end > offset] or [
        Phone(SILENCE, 0.0, 1 / FPS)
    ]
