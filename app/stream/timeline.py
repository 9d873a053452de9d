"""What a stream shows and plays when: frames for the pool's lane and sound for the ticker, on one clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from app.engine.pool import FrameJob, Lane
from app.stream.clock import BLOCK_SAMPLES, FPS, FRAME_SAMPLES, SAMPLE_RATE, StreamClock, first_frame_at
from app.stream.pieces import HISTORY_FRAMES, Articulator, Coefficients, Piece, joined, to_rest
from app.stream.soundtrack import Samples, Soundtrack

EASE_FRAMES = 6
"""How long a mouth takes to close when the next piece is late: 0.24 s, as at the end of a sentence."""
CLOSE_FRAMES = 3
"""How long it takes when speech is cut short: 0.12 s, as before an /m/."""
UNHEARD_SECONDS = 0.5
"""Silence that could not be sent in time is sent late, up to this: gaps in the sound make players stumble."""
LEAD_SECONDS = 0.05
"""From leaving the server to being shown: how far the background runs ahead of the phase of the page's idle clip."""

Owner = TypeVar("Owner")


@dataclass(frozen=True, slots=True)
class IdlePhase:
    """Where the page's idle clip was.

    Attributes:
        frame: the loop frame shown.
        at_ms: when, milliseconds since 1970 on the server's clock.
    """

    frame: float
    at_ms: float


@dataclass(frozen=True, slots=True)
class Look(Generic[Owner]):
    """What a frame shows (the payload of its `FrameJob`).

    Attributes:
        coefficients: of the mouth, shape (K,); None = the background alone.
        loop_frame: of the background.
        keyframe: decoding must be able to start here.
        owner: whose speech this is.
    """

    coefficients: Coefficients | None
    loop_frame: int
    keyframe: bool
    owner: Owner | None


class Timeline(Generic[Owner]):
    """Frames and sound of one stream. Used by one thread; the lane's callbacks run elsewhere.

    A frame may be encoded from its release on, and is due `encode_ahead` seconds later: what lies ahead of the release
    can be taken back. Sound leaves in blocks of 20 ms, each at its own time.

    Args:
        articulator: the avatar.
        loop_frames: length of its background loop.
        clock: what frames and samples are timed by.
        lane: where the frames go.
        encode_ahead: seconds from a frame's release to its deadline; the lane's own.
        horizon: seconds of idle frames handed to the lane in advance.

    Attributes:
        clock: of the stream.
        sent: samples whose sound has left. After a pause of the whole process this is behind `clock`.
    """

    def __init__(
        self,
        articulator: Articulator,
        loop_frames: int,
        clock: StreamClock,
        lane: Lane,
        *,
        encode_ahead: float,
        horizon: float,
    ) -> None:
        self._articulator = articulator
        self._loop_frames = loop_frames
        self.clock = clock
        self._lane = lane
        self._encode_ahead = encode_ahead
        self._horizon = horizon
        self._sound = Soundtrack()
        self.sent = 0
        self._next = 0  # the next frame to submit
        self._shift = 0  # loop frame of frame 0
        self._phase: IdlePhase | None = None
        self._mouths: deque[tuple[int, Coefficients]] = deque()  # (first frame, rows), for continuing from any frame

    def set_phase(self, phase: IdlePhase) -> None:
        """Let the background run in step with the page's clip from the next start of the video on.

        While video flows the background never jumps, so a phase that comes then waits for the next start.
        """
        self._phase = phase

    def loop_frame(self, frame: int) -> int:
        """The background frame that goes with a frame of the stream."""
        return (frame + self._shift) % self._loop_frames

    def begin(self, now: float) -> int:
        """The first frame that can still be chosen; idle frames that wait to be encoded are taken back for it."""
        self._catch_up(now)
        frame = self._present(now)
        self._take_back(frame)
        return max(frame, self._next)

    def place(self, piece: Piece, base: int, owner: Owner, now: float) -> int:
        """Put a piece on the stream's clock.

        Args:
            piece: a piece of the utterance whose first frame is `base`.
            base: frame of the stream.
            owner: of the frames.
            now: seconds on the clock.

        Returns:
            The frames by which it had to be delayed, because what it should follow is already past. Until then there is
            silence; all that follows has to be delayed likewise.
        """
        self._catch_up(now)
        frame = base + piece.frame
        sample = base * FRAME_SAMPLES + piece.sample
        delay = first_frame_at(max(0, self.sent - sample))
        self._take_back(frame + delay)
        delay = max(delay, self._next - frame)
        self._sound.add(sample + delay * FRAME_SAMPLES, piece.samples)
        rows = joined(piece, self._before(frame + delay)[-1])
        self._submit(frame + delay, list(rows), owner, start=piece.frame == 0)
        self._remember(frame + delay, rows)
        return delay

    def fill(self, now: float, owner: Owner | None) -> None:
        """Hand the lane what is shown between and after speech, as far as the horizon.

        Args:
            now: seconds on the clock.
            owner: the utterance whose next piece is late, or None when idle.
        """
        self._catch_up(now)
        frame = max(self._next, self._present(now))
        last = int((now + self._horizon - self.clock.origin) * FPS)
        if frame > last:
            return
        if owner is not None and frame == self._speech_end:
            frame = self._ease(frame, owner, EASE_FRAMES)
        if frame <= last:
            self._submit(frame, [None] * (last + 1 - frame), owner, start=False)

    def close_mouth(self, now: float, owner: Owner) -> int:
        """Bring the mouth to rest after what has been placed; returns the frame after that."""
        self._catch_up(now)
        frame = max(self._speech_end, first_frame_at(self.sent))
        self._take_back(frame)
        return self._ease(max(frame, self._next), owner, EASE_FRAMES)

    def interrupt(self, now: float, owner: Owner) -> int:
        """Fade the sound out and close the mouth, from what cannot be taken back on; returns the frame after that."""
        self._catch_up(now)
        frame = first_frame_at(self.sent)
        self._take_back(frame)
        self._sound.cut(self.sent)
        return self._ease(max(frame, self._next), owner, CLOSE_FRAMES)

    def stop(self, now: float) -> None:
        """No more video for now: take back what waits to be encoded."""
        self._catch_up(now)
        self._take_back(first_frame_at(self.sent))

    def sound(self, now: float) -> Iterator[tuple[int, Samples]]:
        """The blocks that have to leave now: first sample, and `BLOCK_SAMPLES` samples."""
        self._catch_up(now)
        due = self.clock.due_sample(now)
        while self.sent < due:
            block = self._sound.read(self.sent, BLOCK_SAMPLES)
            position, self.sent = self.sent, self.sent + BLOCK_SAMPLES
            yield position, block

    def _ease(self, frame: int, owner: Owner | None, frames: int) -> int:
        rows = to_rest(self._articulator, frames, self._before(frame))
        self._submit(frame, list(rows), owner, start=False)
        self._remember(frame, rows)
        return frame + frames

    @property
    def _speech_end(self) -> int:
        return self._mouths[-1][0] + len(self._mouths[-1][1]) if self._mouths else -1

    def _catch_up(self, now: float) -> None:
        # Nobody has taken sound for a while because nobody listened: the clock went on without us.
        due = self.clock.due_sample(now)
        if not self._sound.end and due - self.sent > UNHEARD_SECONDS * SAMPLE_RATE:
            self.sent = due - BLOCK_SAMPLES

    def _present(self, now: float) -> int:
        # Where nothing is heard, the sound may be behind; pictures need not be.
        due = self.clock.due_sample(now) - BLOCK_SAMPLES
        return first_frame_at(self.sent if self._sound.end else max(self.sent, due))

    def _take_back(self, frame: int) -> None:
        # Frames from `frame` on were submitted without gaps: gaps only come from time passing.
        self._next -= self._lane.discard(frame)
        while self._mouths and self._speech_end > max(frame, self._next):
            first, rows = self._mouths.pop()
            if first < max(frame, self._next):
                self._mouths.append((first, rows[: max(frame, self._next) - first]))

    def _submit(self, frame: int, looks: list[Coefficients | None], owner: Owner | None, *, start: bool) -> None:
        resumed = frame > self._next or frame == 0
        if resumed and self._phase is not None:
            ahead = (self.clock.wall_ms(frame / FPS) - self._phase.at_ms) / 1000 + LEAD_SECONDS
            self._shift = round(self._phase.frame + ahead * FPS) - frame
            self._phase = None
        self._lane.submit(
            FrameJob(
                n,
                self.clock.frame_release(n) + self._encode_ahead,
                Look(look, self.loop_frame(n), (start or resumed) and n == frame, owner),
            )
            for n, look in enumerate(looks, frame)
        )
        self._next = frame + len(looks)

    def _remember(self, frame: int, rows: Coefficients) -> None:
        if len(rows):
            self._mouths.append((frame, rows))
        past = first_frame_at(self.sent) - HISTORY_FRAMES
        while self._mouths and self._mouths[0][0] + len(self._mouths[0][1]) < past:
            self._mouths.popleft()

    def _before(self, frame: int) -> Coefficients:
        # The mouths of the frames just before, the mouth at rest where there was only background.
        rows = np.repeat(self._articulator.rest[None], HISTORY_FRAMES, axis=0)
        for first, block in self._mouths:
            for n in range(max(first, frame - HISTORY_FRAMES), min(first + len(block), frame)):
                rows[n - frame + HISTORY_FRAMES] = block[n - first]
        return rows
