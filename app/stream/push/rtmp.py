"""A stream to an RTMP server, by FFmpeg through PyAV."""

from __future__ import annotations

import io
import os
import socket
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from typing import Any, BinaryIO

import av
import av.logging

from app.stream.packet import Packet
from app.stream.push.pipe import PublishOrder, read_packet
from app.stream.push.publication import Failure, PublishingFailed, reason, within

SEND_BUFFER = 128 << 10  # bytes the kernel holds for a slow server: some seconds of the stream
CLOSE_SECONDS = 1.0

_FILES = range(3, 256)  # where the socket that FFmpeg opens is


class RtmpPublication:
    """See `app.stream.push.publication.Publication`."""

    def __init__(self, order: PublishOrder) -> None:
        self._order = order
        self._output: Any = None
        self._start: Fraction | None = None

    def connect(self, request_keyframe: Callable[[], None]) -> None:  # noqa: ARG002
        """Open the connection; nobody asks for key frames in RTMP."""
        order = self._order
        options = {"flvflags": "no_duration_filesize", "flush_packets": "1"}
        messages: list[str] = []
        try:
            with within(order.stall_seconds), _messages(messages):
                self._output = av.open(order.url, "w", format="flv", options=options)
                with av.open(io.BytesIO(order.head), format="mp4") as tracks:
                    self._video: Any = self._output.add_stream_from_template(tracks.streams.video[0])
                    self._sound: Any = self._output.add_stream_from_template(tracks.streams.audio[0])
                self._video.codec_context.extradata = order.extradata
                self._output.start_encoding()
        except Exception as error:
            raise PublishingFailed(explain(error, messages)) from error
        bound_sockets(order.stall_seconds)

    def feed(self, source: BinaryIO) -> None:
        """Send packets until the input ends."""
        try:
            while (packet := read_packet(source)) is not None:
                self._send(packet)
        except TimeoutError as error:
            text = f"the server has taken nothing for {self._order.stall_seconds:g} s"
            raise PublishingFailed(Failure(text)) from error
        except OSError as error:
            raise PublishingFailed(Failure(f"the connection broke: {reason(error)}")) from error

    def close(self) -> None:
        """Tell the server that the stream is over."""
        if self._output is not None:
            with within(CLOSE_SECONDS):
                self._output.close()

    def _send(self, packet: Packet) -> None:
        # The server's time begins with the first picture, a key frame. Sound from before it has no place there: FFmpeg
        # takes no packet that is earlier than its first.
        time = packet.pts * packet.time_base
        if self._start is None:
            if not packet.starts:
                return
            self._start = time
        if time < self._start:
            return
        offset = round(self._start / packet.time_base)
        sent = packet.to_av()
        sent.pts, sent.dts = packet.pts - offset, packet.dts - offset
        sent.stream = self._video if packet.kind == "video" else self._sound
        with within(self._order.stall_seconds):
            self._output.mux(sent)


def explain(error: Exception, messages: Sequence[str]) -> Failure:
    """Why a connection did not come about.

    Args:
        error: what was raised.
        messages: what FFmpeg said meanwhile. RTMP servers mostly hang up without giving a reason; then how far FFmpeg
            got tells what it was that they did not like.
    """
    said = "\n".join(messages)
    if "Failed to resolve hostname" in said:
        return Failure("the server's name cannot be resolved")
    detail = said.partition("Server error:")[2].partition("\n")[0].strip()
    if "Sending publish command" in said:
        return Failure("the server refused to publish: wrong key, not authenticated, or in use", True, detail)
    if "Server version" in said:
        return Failure("the server refused the application of the URL, or wants a login", True, detail)
    return Failure(f"the server cannot be reached: {reason(error)}")


@contextmanager
def _messages(said: list[str]) -> Iterator[None]:
    """Collect what FFmpeg says."""
    av.logging.set_level(av.logging.DEBUG)  # how far FFmpeg got is told there only
    try:
        with av.logging.Capture(local=False) as captured:
            try:
                yield
            finally:
                said += [message for _, _, message in captured]
    finally:
        av.logging.set_level(None)


def bound_sockets(seconds: float) -> None:
    """Give up a connection whose other end takes nothing for so long, and keep little for it meanwhile.

    A server that has stopped is noticed late otherwise: its kernel and ours take megabytes before a write waits.
    FFmpeg has options for that, but PyAV opens the connection without any.
    """
    for number in _FILES:
        try:
            if not stat.S_ISSOCK(os.fstat(number).st_mode):
                continue
            connection = socket.socket(fileno=os.dup(number))
        except OSError:
            continue
        with connection:
            if connection.family not in (socket.AF_INET, socket.AF_INET6) or connection.type != socket.SOCK_STREAM:
                continue
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if hasattr(socket, "TCP_USER_TIMEOUT"):
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1000 * seconds))
