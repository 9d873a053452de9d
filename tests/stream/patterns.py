"""Pictures that say which frame they are, sound that says when it is, and live packets made of both."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.stream.clock import SAMPLE_RATE
from app.stream.encoder import AAC_FRAME, OPUS_FRAME, AacEncoder, OpusEncoder, VideoEncoder
from app.stream.packet import Packet

WIDTH, HEIGHT, FPS = 128, 128, 25
_BLOCK, _BITS = 16, 16  # a 4 x 4 grid of blocks at the top left


def picture(index: int, width: int = WIDTH, height: int = HEIGHT) -> NDArray[np.uint8]:
    """An I420 picture with `index` written in black and white blocks, and a square that moves."""
    whole = np.full((height * 3 // 2, width), 128, np.uint8)
    luma = whole[:height]
    for bit in range(_BITS):
        row, column = divmod(bit, 4)
        value = 220 if index >> bit & 1 else 32
        luma[row * _BLOCK : (row + 1) * _BLOCK, column * _BLOCK : (column + 1) * _BLOCK] = value
    left = 64 + index * 4 % (width - 64 - 16)
    luma[80:96, left : left + 16] = 200
    return whole


def read_index(luma: NDArray[np.uint8]) -> int:
    """The index written in a decoded picture; also raises AssertionError if a block is neither black nor white."""
    index = 0
    for bit in range(_BITS):
        row, column = divmod(bit, 4)
        block = luma[row * _BLOCK + 4 : (row + 1) * _BLOCK - 4, column * _BLOCK + 4 : (column + 1) * _BLOCK - 4]
        level = float(block.mean())
        assert level < 70 or level > 180, f"block {bit} is {level}"
        index |= (level > 126) << bit
    return index


def beeps(first: int, count: int) -> NDArray[np.float32]:
    """Samples first..first+count: 1 kHz in the first tenth of every second, silence otherwise."""
    time = np.arange(first, first + count) / SAMPLE_RATE
    return (0.5 * np.sin(2 * np.pi * 1000 * time) * (time % 1 < 0.1)).astype(np.float32)


class Studio:
    """Encoders of a small live stream, and packets in the order in which they come out."""

    def __init__(self, **options: object) -> None:
        self.video = VideoEncoder(WIDTH, HEIGHT, FPS, **options)  # type: ignore[arg-type]
        self.opus = OpusEncoder()
        self.aac = AacEncoder()
        self.index = 0

    def frame(self, *, picture_too: bool = True, keyframe: bool = False) -> list[Packet]:
        """The next 40 ms: one picture and two blocks of sound."""
        packets: list[Packet] = []
        if picture_too:
            packets += self.video.encode(picture(self.index), self.index, keyframe=keyframe)
        for half in range(2):
            first = (2 * self.index + half) * OPUS_FRAME
            sound = beeps(first, OPUS_FRAME)
            packets += self.opus.encode(sound, first)
            packets += self.aac.encode(sound, first)
        self.index += 1
        return packets

    def frames(self, count: int) -> list[Packet]:
        return [packet for _ in range(count) for packet in self.frame()]


__all__ = [
    "AAC_FRAME",
    "FPS",
    "HEIGHT",
    "OPUS_FRAME",
    "SAMPLE_RATE",
    "WIDTH",
    "Studio",
    "beeps",
    "picture",
    "read_index",
]
