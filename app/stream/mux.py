"""Packets to container formats: live for viewers over HTTP, and finished files."""

from __future__ import annotations

import asyncio
import logging
import os
import tempfile
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import av

from app.stream.broadcast import Broadcast
from app.stream.container import Chunk, Container, Format
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.flv import FlvFormat
from app.stream.fmp4 import Mp4Format
from app.stream.packet import Packet

EARLY_PACKETS = 512  # sound kept until the first key frame comes (11 s); what is older is dropped

_log = logging.getLogger(__name__)

_CONTAINERS: dict[Format, Callable[[VideoEncoder, AacEncoder], Container]] = {"flv": FlvFormat, "mp4": Mp4Format}


class LiveMuxer:
    """One format of one stream: muxed once, the bytes shared by all its viewers.

    It works from the first viewer on and stops with the last. A viewer gets the header and everything from the last
    key frame on. All calls on the event loop.

    Args:
        format: "flv" or "mp4" (fragmented).
        source: where "video" and "aac" packets come from.
        video, audio: the encoders the packets are from, for the header.
        queue_seconds: a viewer this far behind is cut to the next key frame, and disconnected if that happens often.
    """

    def __init__(
        self,
        format: Format,
        source: Broadcast[Packet],
        video: VideoEncoder,
        audio: AacEncoder,
        *,
        queue_seconds: float = 4.0,
    ) -> None:
        self._format = format
        self._create: Callable[[], Container] = partial(_CONTAINERS[format], video, audio)
        self._source = source
        self._queue_seconds = queue_seconds
        self._chunks: Broadcast[Chunk] | None = None
        self._task: asyncio.Task[None] | None = None

    async def watch(self) -> AsyncIterator[bytes]:
        """A viewer, from the first iteration until this generator is closed.

        It ends by itself after the end of the source, or when the viewer is too slow.
        """
        if self._source.closed:
            return
        if self._chunks is None or self._chunks.closed:
            self._chunks = Broadcast(self._queue_seconds)
            self._task = asyncio.create_task(self._mux(self._chunks))
        chunks = self._chunks
        try:
            with chunks.subscribe() as subscription:
                async for chunk in subscription:
                    yield chunk.data
        finally:
            if chunks.subscribers == 0 and self._chunks is chunks:
                await self.close()

    async def close(self) -> None:
        """Stop muxing; viewers get what is queued and then the end."""
        task, self._task = self._task, None
        if self._chunks is not None:
            self._chunks.close()
            self._chunks = None
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def _mux(self, chunks: Broadcast[Chunk]) -> None:
        try:
            container = self._create()
            chunks.publish(container.header)
            with self._source.subscribe({"video", "aac"}) as packets:
                async for packet in packets:
                    for chunk in container.write(packet):
                        chunks.publish(chunk)
            for chunk in container.flush():
                chunks.publish(chunk)
        except Exception:
            _log.exception("muxing %s failed; its viewers are disconnected", self._format)
        finally:
            chunks.close()


class Mp4File:
    """A finished MP4 that starts fast, written packet by packet: beside its place first, then moved there.

    The first key frame is time 0 of both tracks; sound from before it is left out, but for the coder's priming, which
    players skip. Packets of the two kinds may come in any order, each kind in its own; Opus is ignored. Any thread.

        with Mp4File(path, video, audio) as file:
            file.add(packet)

    On an exception, or after `discard`, nothing is left.
    """

    def __init__(self, path: Path, video: VideoEncoder, audio: AacEncoder | None) -> None:
        self._path = path
        self._lock = threading.Lock()
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
        os.close(handle)
        self._part = Path(name)
        self._output: Any = None
        try:
            self._output = av.open(name, "w", format="mp4", options={"movflags": "faststart+write_colr"})
            self._video: Any = self._output.add_stream_from_template(video.template)
            self._audio: Any = self._output.add_stream_from_template(audio.template) if audio is not None else None
        except BaseException:
            self.discard()
            raise
        self._start: Fraction | None = None
        self._early: deque[Packet] = deque(maxlen=EARLY_PACKETS)

    def __enter__(self) -> Mp4File:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.finish()
        else:
            self.discard()

    def add(self, packet: Packet) -> None:
        """Write a packet. Video before the first key frame is left out."""
        with self._lock:
            if self._output is None or packet.kind == "opus" or (packet.kind == "aac" and self._audio is None):
                return
            if self._start is None:
                if packet.kind == "aac":
                    self._early.append(packet)
                    return
                if not packet.keyframe:
                    return
                self._start = packet.pts * packet.time_base
                self._mux(packet, self._video)
                for early in self._early:
                    self._sound(early)
                self._early.clear()
            elif packet.kind == "video":
                self._mux(packet, self._video)
            else:
                self._sound(packet)

    def finish(self) -> None:
        """Complete the file and move it to its place."""
        with self._lock:
            output, self._output = self._output, None
            if output is None:
                return
            try:
                output.start_encoding()
                output.close()
                self._part.chmod(0o644)
                self._part.replace(self._path)
            except BaseException:
                self._part.unlink(missing_ok=True)
                raise

    def discard(self) -> None:
        """Leave nothing. After `finish` this does nothing."""
        with self._lock:
            output, self._output = self._output, None
            try:
                if output is not None:
                    output.close()
            finally:
                self._part.unlink(missing_ok=True)

    def _sound(self, packet: Packet) -> None:
        assert self._start is not None
        first = self._start - packet.duration * packet.time_base  # one packet before: a decoder needs it to set out
        if packet.pts * packet.time_base >= first:
            self._mux(packet, self._audio)

    def _mux(self, packet: Packet, track: Any) -> None:
        assert self._start is not None
        offset = round(self._start / packet.time_base)
        written = packet.to_av()
        written.pts, written.dts = packet.pts - offset, packet.dts - offset
        written.stream = track
        self._output.mux(written)
