"""An avatar without a service: sound is pushed, pictures with their sound come out. For programs with transports of
their own, such as agents that speak by a model's voice.

There is no HTTP and no codec in it. Time is kept as on a stream: a picture every 40 ms, idle while there is nothing to
say, and a mouth that closes when sound is late or cut short.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from app.engine.frame import Picture, empty
from app.speech import Speech
from app.stream.clock import FPS, FRAME_SAMPLES
from app.stream.narration import Narration
from app.stream.pieces import HISTORY_FRAMES, Articulator, Coefficients, Piece, joined, pieces, to_rest
from app.stream.soundtrack import FADE_SAMPLES, Samples
from app.stream.timeline import CLOSE_FRAMES, EASE_FRAMES


class Feed(Protocol):
    """What sound is pushed to (see `app.align.live_sound.LiveSound`). Safe from any thread."""

    def push_audio(self, sound: Any) -> None: ...

    def flush(self) -> None: ...

    def end(self) -> None: ...

    def interrupt(self) -> None: ...

    def cancel(self) -> None: ...

    def speeches(self) -> Iterator[Speech | None]: ...


class Look(Protocol):
    """What is needed of an avatar's manifest here."""

    @property
    def width(self) -> int: ...

    @property
    def height(self) -> int: ...


class Face(Articulator, Protocol):
    """What is needed of an avatar here (see `app.engine.avatar.Avatar`)."""

    @property
    def manifest(self) -> Look: ...

    def render(self, coefficients: Coefficients | None, loop_frame: int, out: Picture) -> None: ...


@dataclass(frozen=True, slots=True)
class AvatarFrame:
    """40 ms of an avatar.

    Attributes:
        number: counts from 0.
        picture: I420, shape (height * 3 // 2, width), uint8.
        sound: what is heard while it is shown: 1,920 samples, 48 kHz, mono, float32.
        speaking: it belongs to speech; else the avatar idles.
    """

    number: int
    picture: Picture
    sound: Samples
    speaking: bool


class AvatarRunner:
    """Turns pushed sound into pictures with sound. Calls and iteration on one event loop; one iteration only.

    Args:
        avatar: who speaks; 25 pictures a second.
        feed: what sound is pushed to, new.
        paced: frames come at the pace of time, idle ones too. Otherwise they come as fast as they can be made and only
            while there is speech: for files.
    """

    def __init__(self, avatar: Face, feed: Feed, *, paced: bool = True) -> None:
        self._avatar = avatar
        self._feed = feed
        self._paced = paced
        self._generation = 0  # how often it was interrupted
        self._asked = 0  # generation in which the piece in work was asked for
        self._narration: Narration | None = None
        self._ready: deque[Piece] = deque()
        self._changed = asyncio.Event()
        self._narrated = False
        self._failure: BaseException | None = None
        self._rows: deque[Coefficients] = deque()  # mouths to be shown
        self._sound = np.zeros(0, np.float32)  # that goes with them
        self._shown: deque[Coefficients] = deque([avatar.rest] * HISTORY_FRAMES, HISTORY_FRAMES)
        self._closing: deque[Coefficients] = deque()  # mouths on their way to rest

    def push_audio(self, sound: Any) -> None:
        """More to say; see the feed for what it takes and refuses."""
        self._feed.push_audio(sound)

    def flush(self) -> None:
        """Say what has been pushed without waiting for what follows."""
        self._feed.flush()

    def end(self) -> None:
        """Nothing follows: the iteration ends when all is said."""
        self._feed.end()

    def interrupt(self) -> None:
        """Fall silent at once, close the mouth, forget what has not been said. More may be pushed."""
        self._generation += 1
        self._feed.interrupt()
        while self._ready:
            self._ready.popleft()
            self._taken()
        if self._rows or len(self._sound):
            self._rows.clear()
            fade = np.linspace(1.0, 0.0, FADE_SAMPLES, dtype=np.float32)[: len(self._sound)]
            self._sound = self._sound[: len(fade)] * fade
            self._close_mouth(CLOSE_FRAMES)

    async def __aiter__(self) -> AsyncIterator[AvatarFrame]:
        """The frames, from now until all is said after `end`.

        Raises:
            MaryError: what the feed's speeches raise.
        """
        loop = asyncio.get_running_loop()
        self._narration = narration = Narration(self._pieces, self._deliverer(loop), "mary-runner")
        started, number = loop.time(), 0
        try:
            while True:
                self._take()
                over = self._narrated and not self._ready
                if not (self._due or self._closing or self._paced or over):
                    self._changed.clear()
                    await self._changed.wait()
                    continue
                mouth, sound, speaking = self._next()
                if over and not speaking:
                    if self._failure is not None:
                        raise self._failure
                    return
                picture = empty(self._avatar.manifest.width, self._avatar.manifest.height)
                await asyncio.to_thread(self._avatar.render, mouth, number, picture)
                if self._paced:
                    await asyncio.sleep(max(0.0, started + number / FPS - loop.time()))
                yield AvatarFrame(number, picture, sound, speaking)
                number += 1
        finally:
            self._feed.cancel()
            narration.cancel()

    # --- what is shown next

    @property
    def _due(self) -> bool:
        """The next frame of speech is there, with all its sound."""
        return bool(self._rows) and len(self._sound) >= FRAME_SAMPLES

    def _next(self) -> tuple[Coefficients | None, Samples, bool]:
        """Mouth (None: at rest), sound, and whether it is speech."""
        mouth: Coefficients | None = None
        speaking = late = False
        if self._due:
            mouth, speaking = self._rows.popleft(), True
            self._closing.clear()
        else:
            late = bool(self._rows)  # a piece ends inside of a frame; what there is of its sound waits for the rest
            if not self._closing and not self._resting:
                self._close_mouth(EASE_FRAMES)
            if self._closing:
                mouth, speaking = self._closing.popleft(), True
        self._shown.append(self._avatar.rest if mouth is None else mouth)
        sound = np.zeros(FRAME_SAMPLES, np.float32)
        if not late:
            count = min(FRAME_SAMPLES, len(self._sound))
            sound[:count] = self._sound[:count]
            self._sound = self._sound[count:]
        return mouth, sound, speaking

    @property
    def _resting(self) -> bool:
        return bool((self._shown[-1] == self._avatar.rest).all())

    def _close_mouth(self, frames: int) -> None:
        self._closing = deque(to_rest(self._avatar, frames, np.stack(self._shown)))

    def _take(self) -> None:
        """Take the next piece when the one before is all but shown."""
        while self._ready and len(self._rows) <= 1:
            piece = self._ready.popleft()
            self._taken()
            self._rows.extend(piece.coefficients if self._rows else joined(piece, self._shown[-1]))
            self._sound = np.concatenate([self._sound, piece.samples])

    # --- the thread that makes speech

    def _pieces(self) -> Iterator[Piece | None]:
        made = pieces(self._avatar, self._feed.speeches())
        while True:
            self._asked = self._generation
            try:
                piece = next(made)
            except StopIteration:
                return
            yield piece

    def _taken(self) -> None:
        if self._narration is not None:
            self._narration.taken()

    def _deliverer(self, loop: asyncio.AbstractEventLoop) -> Callable[[Piece | BaseException | None], None]:
        def deliver(news: Piece | BaseException | None) -> None:
            with contextlib.suppress(RuntimeError):  # the event loop is gone
                loop.call_soon_threadsafe(self._delivered, news, self._asked)

        return deliver

    def _delivered(self, news: Piece | BaseException | None, asked: int) -> None:
        if not isinstance(news, Piece):
            self._failure, self._narrated = news, True
        elif asked == self._generation:
            self._ready.append(news)
        else:  # made of what was interrupted
            self._taken()
        self._changed.set()
