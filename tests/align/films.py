"""Small video files with sound at known times."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

PICTURES = 25  # a second
CHUNK = 1024  # samples a packet


def film(
    path: Path,
    samples: NDArray[np.float32] | None,
    rate: int = 16_000,
    *,
    codec: str = "pcm_s16le",
    form: str = "s16",
    layout: str = "mono",
    channel: int | None = None,
    picture: str = "mpeg4",
    picture_at: float = 0.0,
    sound_at: float = 0.0,
    change: Callable[[int, Any], Any] = lambda _, packet: packet,
    options: dict[str, str] | None = None,
) -> Path:
    """Write a film as long as its sound.

    Args:
        path: its suffix decides the container.
        samples: mono, shape (n,); a second without sound if None.
        rate: samples a second.
        codec: of the sound.
        form: sample format that the codec takes.
        layout: of the channels.
        channel: the only one that has sound; all if None.
        picture: codec of the picture; "" leaves it out.
        picture_at: presentation time of the first picture, seconds.
        sound_at: presentation time of the first sample, seconds.
        change: given the number of each packet of sound and the packet; what it returns is written, None drops it.
        options: of the container.
    """
    seconds = 1.0 if samples is None else len(samples) / rate
    packets: list[tuple[float, Any]] = []
    with av.open(str(path), "w", options=options or {}) as output:
        if picture:
            video: Any = output.add_stream(picture, PICTURES, width=32, height=32, pix_fmt="yuv420p")
        if samples is not None:
            audio: Any = output.add_stream(codec, rate, layout=layout)
            audio.codec_context.format = form
            audio.codec_context.open()
            size = audio.codec_context.frame_size or CHUNK
            number = 0
            frames = [
                _sound(samples[at : at + size], at, rate, form, layout, channel) for at in range(0, len(samples), size)
            ]
            for frame in [*frames, None]:
                for packet in audio.encode(frame):
                    packet.pts += round(sound_at / packet.time_base)
                    packet.dts = packet.pts
                    time = float(packet.pts * packet.time_base)
                    if (changed := change(number, packet)) is not None:
                        packets.append((time, changed))
                    number += 1
        if picture:
            for number in range(round(seconds * PICTURES)):
                image = av.VideoFrame.from_ndarray(np.full((32, 32, 3), 40 + number % 100, np.uint8), format="rgb24")
                image.pts, image.time_base = number, Fraction(1, PICTURES)
                packets += [(0.0, packet) for packet in video.encode(image)]
            packets += [(0.0, packet) for packet in video.encode(None)]
            for at, (_, packet) in enumerate(packets):
                if packet.stream is video:
                    packet.pts += round(picture_at / packet.time_base)
                    packet.dts = packet.pts
                    packets[at] = (float(packet.pts * packet.time_base), packet)
        for _, packet in sorted(packets, key=lambda each: each[0]):
            output.mux(packet)
    return path


def _sound(
    samples: NDArray[np.float32], at: int, rate: int, form: str, layout: str, channel: int | None
) -> av.AudioFrame:
    count = av.AudioLayout(layout).nb_channels
    channels = np.zeros((count, len(samples)), np.float32)
    channels[slice(None) if channel is None else channel] = samples
    frame = av.AudioFrame.from_ndarray(channels, format="fltp", layout=layout)
    frame.sample_rate, frame.pts, frame.time_base = rate, at, Fraction(1, rate)
    (converted,) = av.AudioResampler(form, layout, rate).resample(frame)
    converted.pts, converted.time_base = at, Fraction(1, rate)
    return converted


def click(seconds: float, at: float, rate: int = 16_000) -> NDArray[np.float32]:
    """Silence with a short burst that begins `at` seconds."""
    samples = np.zeros(round(seconds * rate), np.float32)
    first = round(at * rate)
    samples[first : first + rate // 50] = 0.5 * np.sin(np.arange(rate // 50) * 0.4)
    return samples


def clicks(samples: NDArray[np.float32], rate: int) -> list[float]:
    """When bursts begin, seconds."""
    loud = np.flatnonzero(np.abs(samples) > 0.1)
    first = np.concatenate([[True], np.diff(loud) > rate // 20]) if len(loud) else []
    return [round(float(each) / rate, 3) for each in loud[first]]
