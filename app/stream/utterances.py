"""What a stream has said and has to say, and the videos of it; outlives the stream itself."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from app.errors import NotFound, NotReady
from app.stream.utterance import Utterance, UtteranceReport

KEPT_UTTERANCES = 50
"""Utterances a stream remembers; with the oldest its file goes."""


class Utterances:
    """The last utterances of a stream in their order."""

    def __init__(self) -> None:
        self._kept: dict[str, Utterance] = {}

    def __len__(self) -> int:
        return len(self._kept)

    def __iter__(self) -> Iterator[Utterance]:
        return iter(self._kept.values())

    def add(self, utterance: Utterance) -> None:
        """Keep one more; the oldest may be forgotten for it."""
        self._kept[utterance.id] = utterance
        while len(self._kept) > KEPT_UTTERANCES:
            oldest = next(iter(self._kept.values()))
            if not oldest.finished or (oldest.recording is not None and not oldest.recording.settled):
                return
            del self._kept[oldest.id]
            if oldest.recording is not None:
                oldest.recording.remove()

    def find(self, utterance: str) -> Utterance:
        """The utterance of this id; NotFound if there is none (any more)."""
        found = self._kept.get(utterance)
        if found is None:
            raise NotFound(f"no utterance {utterance}")
        return found

    def reports(self) -> tuple[UtteranceReport, ...]:
        """All of them, for the outside."""
        return tuple(utterance.report() for utterance in self)

    def video(self, utterance: str | None = None) -> Path:
        """The finished file of an utterance, by default of the last.

        Raises:
            NotFound: no such utterance, or it has no file (any more).
            NotReady: it is still being spoken or written.
        """
        if utterance is None and not self._kept:
            raise NotFound("nothing has been said yet")
        chosen = next(reversed(self._kept.values())) if utterance is None else self.find(utterance)
        recording = chosen.recording
        if recording is not None and recording.ready:
            return recording.path
        if not chosen.finished or (recording is not None and not recording.failed):
            raise NotReady("the video is being made", advice="Try again when the utterance has ended.")
        raise NotFound("this utterance has no video", advice="Videos are kept for a limited time.")

    def expire(self, keep_seconds: float) -> bool:
        """Delete files that were finished longer ago; returns whether any are left."""
        now = time.monotonic()
        left = False
        for utterance in self:
            recording = utterance.recording
            if recording is not None and recording.ready:
                if now - recording.finished_at >= keep_seconds:
                    recording.remove()
                else:
                    left = True
        return left
