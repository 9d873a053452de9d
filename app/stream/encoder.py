"""Pictures to H.264, sound to Opus and AAC: every stream is encoded once, whoever watches in whatever format.

The codecs are FFmpeg's, through PyAV. Each encoder sits in an output container of the `null` format, because that is
how PyAV fills in the codec parameters (size, profile, colours, headers) that muxers copy from `template`.

Headers: MP4 and FLV want SPS and PPS beside the stream, a WebRTC viewer who joins late wants them in front of every key
frame. x264 does both when asked for a global header *and* `repeat-headers`.
"""

from __future__ import annotations

import os
import threading
from fractions import Fraction
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from app.stream.clock import BLOCK_SAMPLES, SAMPLE_RATE
from app.stream.packet import Kind, Packet

SAMPLE_TIME = Fraction(1, SAMPLE_RATE)
OPUS_FRAME = BLOCK_SAMPLES  # 20 ms
AAC_FRAME = 1_024  # samples: 21.3 ms

VBV_SECONDS = 1.0  # how far max_kbps may be exceeded for a moment; a key frame has to fit
KEYFRAME_SPACING = 0.5  # seconds between key frames that are asked for
LONGEST_STEP = 2  # frames; browsers take a longer step (over MSE) for a gap, and wait for a key frame

_GLOBAL_HEADER = 1 << 22  # AV_CODEC_FLAG_GLOBAL_HEADER
_BT709 = 1  # AVCOL_PRI_BT709, AVCOL_TRC_BT709 and AVCOL_SPC_BT709 alike
_LIMITED = 1  # AVCOL_RANGE_MPEG


class _Coder:
    """A codec context inside a `null` container; `start` opens it and fills in the template."""

    def __init__(self, codec: str, rate: int) -> None:
        self._container: Any = av.open(os.devnull, "w", format="null")
        self.template: Any = self._container.add_stream(codec, rate=rate)
        self.context: Any = self.template.codec_context
        self.context.flags |= _GLOBAL_HEADER

    def start(self) -> None:
        self._container.start_encoding()

    def close(self) -> None:
        # PyAV's container and its streams hold each other; left to the garbage collector 7 MB would wait for it.
        self._container.close()
        del self.template, self.context, self._container


class VideoEncoder:
    """H.264 from I420 pictures, BT.709 limited range, tagged so in the bit stream.

    Live: constrained baseline without B-frames or look-ahead, one packet out for each picture in, its rate capped.
    Files (`live=False`): high profile with B-frames and look-ahead; packets come later, the last ones from `flush`.

    One caller at a time, only `request_keyframe` may be called from any thread at any time.

    Args:
        width, height: of the picture in pixels, both even.
        fps: pictures a second; `index` counts them.
        preset, crf: x264's speed and quality.
        max_kbps: cap of the live bit rate over a second.
        keyframe_seconds: longest distance between key frames on the stream's clock.
    """

    def __init__(
        self,
        width: int,
        height: int,
        fps: int,
        *,
        preset: str = "superfast",
        crf: float = 21.0,
        max_kbps: int = 2_500,
        keyframe_seconds: float = 2.0,
        live: bool = True,
    ) -> None:
        if width % 2 or height % 2 or width <= 0 or height <= 0:
            raise ValueError(f"width and height must be even, not {width}x{height}")
        self.width, self.height, self.fps, self.live = width, height, fps, live
        self._time_base = Fraction(1, fps)
        self._distance = max(1, round(keyframe_seconds * fps))
        self._spacing = max(1, round(KEYFRAME_SPACING * fps))
        self._last_index: int | None = None
        self._last_keyframe: int | None = None
        self._wanted = threading.Event()

        coder = _Coder("libx264", fps)
        context = coder.context
        context.width, context.height, context.pix_fmt = width, height, "yuv420p"
        context.time_base, context.framerate = self._time_base, Fraction(fps)
        context.color_primaries = context.color_trc = context.colorspace = _BT709
        context.color_range = _LIMITED
        context.thread_count = 1  # a second thread gains nothing; pictures of several streams are what runs in parallel
        options = {
            "preset": preset,
            "crf": f"{crf:g}",
            "forced-idr": "1",
            # Without scene cuts key frames come only when asked for, here by the stream's clock.
            "x264-params": "repeat-headers=1:scenecut=0",
        }
        if live:
            # Gaps in the indices make counting pictures wrong, so x264 never inserts a key frame by itself.
            context.gop_size = 1 << 20
            context.max_b_frames = 0
            options |= {
                "tune": "zerolatency",
                "profile": "baseline",
                "maxrate": str(max_kbps * 1000),
                "bufsize": str(round(max_kbps * 1000 * VBV_SECONDS)),
            }
        else:
            context.gop_size = self._distance
            options |= {"profile": "high"}
        context.options = options
        coder.start()
        self._coder = coder

    @property
    def template(self) -> Any:
        """The track's parameters, for muxers."""
        return self._coder.template

    @property
    def extradata(self) -> bytes:
        """SPS and PPS in Annex B form."""
        return bytes(self._coder.context.extradata)

    def request_keyframe(self) -> None:
        """Make the next picture a key frame, but at most two a second on the stream's clock. From any thread."""
        self._wanted.set()

    def encode(
        self, picture: NDArray[np.uint8], index: int, *, keyframe: bool = False, idle: bool = False
    ) -> list[Packet]:
        """Encode a picture; it is not kept and may be overwritten afterwards.

        Args:
            picture: (height * 3 // 2, width), uint8, contiguous: the I420 planes Y, U, V one after the other.
            index: frame number on the stream's clock; strictly increasing. Gaps are allowed; live, a key frame
                follows one of more than a frame.
            keyframe: decoding must be able to start here.
            idle: live: said of the packet.

        Raises:
            ValueError: the picture has another shape or type, or `index` does not increase.
        """
        expected = (self.height * 3 // 2, self.width)
        if picture.shape != expected or picture.dtype != np.uint8:
            raise ValueError(f"picture must be uint8 {expected}, not {picture.dtype} {picture.shape}")
        if self._last_index is not None and index <= self._last_index:
            raise ValueError(f"index {index} must be greater than {self._last_index}")
        due = self._due(index)
        self._last_index = index
        frame: Any = av.VideoFrame.from_numpy_buffer(np.ascontiguousarray(picture), format="yuv420p")
        frame.pts, frame.time_base = index, self._time_base
        frame.color_primaries = frame.color_trc = frame.colorspace = _BT709
        frame.color_range = _LIMITED
        if keyframe or due:
            frame.pict_type = 1  # AV_PICTURE_TYPE_I, an IDR because of forced-idr
            self._last_keyframe = index
            self._wanted.clear()
        return [self._packet(packet, idle=idle) for packet in self._coder.context.encode(frame)]

    def flush(self) -> list[Packet]:
        """The packets still inside. Nothing can be encoded afterwards."""
        return [self._packet(packet) for packet in self._coder.context.encode(None)]

    def close(self) -> None:
        """Free the codec's memory. Nothing can be asked of the encoder afterwards."""
        self._coder.close()

    def _due(self, index: int) -> bool:
        if self._last_keyframe is None or self._last_index is None:
            return True
        distance = index - self._last_keyframe
        if self._wanted.is_set() and distance >= self._spacing:
            return True
        return self.live and (distance >= self._distance or index - self._last_index > LONGEST_STEP)

    def _packet(self, packet: Any, *, idle: bool = False) -> Packet:
        return Packet(
            kind="video",
            data=bytes(packet),
            pts=packet.pts,
            dts=packet.dts,
            duration=1,
            time_base=self._time_base,
            keyframe=packet.is_keyframe,
            idle=idle,
        )


class _SoundEncoder:
    """Any number of samples in, whole packets out; what does not fill a packet waits for more.

    Packets carry the time stamps of the coder, which start before zero by its priming: a decoder's output played at
    these times is in step with what went in. One caller at a time.
    """

    kind: Kind
    frame: int  # samples in a packet
    sample_format: str

    def __init__(self, codec: str, bit_rate: int, options: dict[str, str]) -> None:
        coder = _Coder(codec, SAMPLE_RATE)
        context = coder.context
        context.layout, context.format, context.sample_rate = "mono", self.sample_format, SAMPLE_RATE
        context.bit_rate, context.time_base = bit_rate, SAMPLE_TIME
        context.options = options
        coder.start()
        self._coder = coder
        self._waiting = np.zeros(0, np.float32)
        self._next: int | None = None  # index of the sample after the last one waiting

    @property
    def template(self) -> Any:
        """The track's parameters, for muxers."""
        return self._coder.template

    @property
    def extradata(self) -> bytes:
        """The codec's header (AudioSpecificConfig, OpusHead)."""
        return bytes(self._coder.context.extradata)

    def encode(self, samples: NDArray[np.float32], pts: int) -> list[Packet]:
        """Encode samples.

        Args:
            samples: (n,) float32, -1..1, 48 kHz; more is clipped.
            pts: index of the first sample on the stream's clock. What is missing since the last call is silence;
                after a gap longer than a packet the coder goes on at the new time.

        Raises:
            ValueError: the samples are not one-dimensional or overlap what was encoded.
        """
        if samples.ndim != 1:
            raise ValueError(f"samples must be one-dimensional, not {samples.shape}")
        packets: list[Packet] = []
        gap = 0 if self._next is None else pts - self._next
        if gap < 0:
            raise ValueError(f"samples from {pts} overlap those before {self._next}")
        if gap > self.frame:
            packets += self._complete()
        elif gap:
            self._waiting = np.concatenate([self._waiting, np.zeros(gap, np.float32)])
        self._next = pts + len(samples)
        waiting = np.concatenate([self._waiting, np.clip(samples, -1.0, 1.0).astype(np.float32, copy=False)])
        first = self._next - len(waiting)
        whole = len(waiting) // self.frame * self.frame
        for start in range(0, whole, self.frame):
            packets += self._frame(waiting[start : start + self.frame], first + start)
        self._waiting = waiting[whole:].copy()
        return packets

    def flush(self) -> list[Packet]:
        """The packets still inside, the last one filled up with silence. Nothing can be encoded afterwards."""
        packets = self._complete()
        return packets + [self._packet(packet) for packet in self._coder.context.encode(None)]

    def close(self) -> None:
        """Free the codec's memory. Nothing can be asked of the encoder afterwards."""
        self._coder.close()

    def _complete(self) -> list[Packet]:
        if not len(self._waiting) or self._next is None:
            return []
        samples, first = self._waiting, self._next - len(self._waiting)
        self._waiting = np.zeros(0, np.float32)
        return self._frame(np.concatenate([samples, np.zeros(self.frame - len(samples), np.float32)]), first)

    def _frame(self, samples: NDArray[np.float32], pts: int) -> list[Packet]:
        frame: Any = av.AudioFrame.from_ndarray(samples[None], format=self.sample_format, layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = SAMPLE_RATE, pts, SAMPLE_TIME
        return [self._packet(packet) for packet in self._coder.context.encode(frame)]

    def _packet(self, packet: Any) -> Packet:
        return Packet(
            kind=self.kind,
            data=bytes(packet),
            pts=packet.pts,
            dts=packet.pts,
            duration=self.frame,
            time_base=SAMPLE_TIME,
            keyframe=True,
        )


class OpusEncoder(_SoundEncoder):
    """20 ms Opus packets, 48 kHz mono; WebRTC announces Opus as stereo always and takes mono packets."""

    kind = "opus"
    frame = OPUS_FRAME
    sample_format = "flt"

    def __init__(self, bit_rate: int = 64_000) -> None:
        super().__init__("libopus", bit_rate, {"application": "audio", "frame_duration": "20"})


class AacEncoder(_SoundEncoder):
    """AAC-LC frames of 1,024 samples, 48 kHz mono."""

    kind = "aac"
    frame = AAC_FRAME
    sample_format = "fltp"

    def __init__(self, bit_rate: int = 96_000) -> None:
        super().__init__("aac", bit_rate, {"aac_coder": "fast"})
