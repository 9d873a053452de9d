"""Draws and encodes the frames of one stream: what runs on the workers of the frame pool."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.engine.frame import Picture
from app.engine.pool import FrameJob
from app.stream.broadcast import Broadcast
from app.stream.encoder import VideoEncoder
from app.stream.packet import Packet
from app.stream.recording import Recording
from app.stream.timeline import Look
from app.stream.timing import UtteranceTimings

_log = logging.getLogger(__name__)


class Renderer(Protocol):
    """What is needed of an avatar here (see `app.engine.avatar.Avatar`)."""

    def render(self, coefficients: NDArray[np.float32] | None, loop_frame: int, out: NDArray[np.uint8]) -> None: ...


class Shot(Protocol):
    """Whose frames these are: an utterance."""

    timings: UtteranceTimings
    recording: Recording | None

    @property
    def face(self) -> Renderer | None: ...


class Film:
    """The callables of a stream's lane in the frame pool.

    Args:
        renderer: the avatar.
        encoder: of the stream.
        broadcast: where packets go.
        on_start: called on a worker when a frame at which decoding can start has been published.

    Attributes:
        passed: the last frame that was encoded or dropped.
    """

    def __init__(
        self, renderer: Renderer, encoder: VideoEncoder, broadcast: Broadcast[Packet], on_start: Callable[[], None]
    ) -> None:
        self.passed = -1
        self._failures = 0  # errors since the last frame that was encoded
        self._on_start = on_start
        self._renderer = renderer
        self._encoder = encoder
        self._broadcast = broadcast

    def draw(self, job: FrameJob) -> Picture:
        """The picture of a job whose payload is a `Look`: I420, shape (height * 3 // 2, width), uint8."""
        look: Look[Shot] = job.payload
        picture = np.empty((self._encoder.height * 3 // 2, self._encoder.width), np.uint8)
        renderer = (look.owner.face if look.owner is not None else None) or self._renderer
        renderer.render(look.coefficients, look.loop_frame, picture)
        if look.owner is not None:
            look.owner.timings.mark("first_frame")
        return picture

    def encode(self, job: FrameJob, picture: Picture) -> None:
        """Encode a picture and hand the packet to viewers and file."""
        look: Look[Shot] = job.payload
        owner = look.owner
        recording = owner.recording if owner is not None else None
        # A first frame that was dropped takes its key frame with it.
        keyframe = look.keyframe or (recording is not None and recording.needs_keyframe)
        for packet in self._encoder.encode(picture, job.index, keyframe=keyframe, idle=owner is None):
            self._broadcast.publish(packet)
            if recording is not None:
                recording.add(packet)
            if owner is not None:
                owner.timings.mark("first_packet")
        self.passed = job.index
        if self._failures:
            _log.error("frames can be made again after %d errors", self._failures)
            self._failures = 0
        if keyframe:
            self._on_start()

    def failed(self, error: BaseException) -> None:
        """A frame cannot be made. Of many in a row the first is told."""
        self._failures += 1
        if self._failures == 1:
            _log.error("a frame cannot be made", exc_info=error)

    def dropped(self, job: FrameJob) -> None:
        """A frame came too late. If decoding was to start there, it has to start at the next one."""
        look: Look[Shot] = job.payload
        if look.keyframe:
            self._encoder.request_keyframe()
        self.passed = job.index
