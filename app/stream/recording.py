"""The finished file of an utterance: its packets, as the viewers got them, written to an MP4 while it is spoken."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from pathlib import Path

from app.stream.clock import FRAME_SAMPLES
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.mux import Mp4File
from app.stream.packet import Packet

_log = logging.getLogger(__name__)


class Recording:
    """One MP4 in the making. `add` may be called from any thread and never raises: a full disk costs the file, not the
    stream.

    Args:
        path: where the finished file will be.
        video, audio: the stream's encoders, for the tracks' parameters.
        first_frame: the frame at which the file starts.

    Attributes:
        ready: the file is there.
        failed: it will never be; there is nothing to wait for.
        finished_at: when it was finished, seconds on the monotonic clock.
    """

    def __init__(self, path: Path, video: VideoEncoder, audio: AacEncoder, first_frame: int) -> None:
        self.path = path
        self.ready = False
        self.failed = False
        self.finished_at = 0.0
        self._first_sample = first_frame * FRAME_SAMPLES
        self._end_sample: int | None = None
        self._last_sound = self._first_sample
        self._started = False
        self._lock = threading.Lock()
        self._file: Mp4File | None = None
        try:
            self._file = Mp4File(path, video, audio)
        except OSError:
            self._fail()

    @property
    def needs_keyframe(self) -> bool:
        """It can begin with a key frame only, and has none yet."""
        return not self._started and not self.failed

    @property
    def has_all_sound(self) -> bool:
        """Its end is known and all its sound is there."""
        return self._end_sample is not None and self._last_sound >= self._end_sample

    @property
    def settled(self) -> bool:
        """It is ready or never will be."""
        return self.ready or self.failed

    def end_at(self, frame: int) -> None:
        """The file ends before this frame of the stream."""
        self._end_sample = frame * FRAME_SAMPLES

    def add(self, packet: Packet) -> None:
        """Take a video packet of the utterance or any AAC packet of the stream; what lies outside is left out."""
        with self._lock:
            if self._file is None:
                return
            if packet.kind == "video":
                self._started = self._started or packet.keyframe
                wanted = self._started
            else:
                end = self._end_sample
                self._last_sound = max(self._last_sound, packet.pts + packet.duration)
                wanted = packet.pts + packet.duration > self._first_sample and (end is None or packet.pts < end)
            if wanted:
                try:
                    self._file.add(packet)
                except Exception:
                    self._fail()

    def finish(self) -> None:
        """Write the rest of the file; blocks."""
        with self._lock:
            file, self._file = self._file, None
            if file is None:
                return
            try:
                file.finish() if self._started else file.discard()
            except Exception:
                self._fail()
                return
            self.finished_at = time.monotonic()
            self.ready, self.failed = self._started, not self._started

    def remove(self) -> None:
        """Delete the file, or give it up."""
        with self._lock:
            file, self._file = self._file, None
            if file is not None:
                file.discard()
            self.ready, self.failed = False, True
            self.path.unlink(missing_ok=True)

    def _fail(self) -> None:
        _log.exception("the video %s cannot be written", self.path.name)
        self.failed = True
        file, self._file = self._file, None
        if file is not None:
            with contextlib.suppress(Exception):  # what cannot be written may not be closed properly either
                file.discard()
