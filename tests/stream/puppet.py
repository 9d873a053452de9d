"""A tiny avatar of the real one's interface: light above while it speaks, the loop's frame number below."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from app.engine.models.sound import Sound
from app.errors import NothingToSay
from app.speech import SILENCE, Phone, Speech
from app.stream.utterance import Reading, Script

SIZE = 64
RATE = 22_050
FPS = 25
PATIENCE = 20.0
BACKGROUND = 40  # luma above when only the background is shown, or the mouth is closed
OPEN = 200  # luma above while a phone sounds


@dataclass(frozen=True)
class TinyManifest:
    id: str = "tiny"
    title: str = "Tiny"
    fps: int = FPS
    width: int = SIZE
    height: int = SIZE
    voice: str = "buzz"
    loop_frames: int = 50


@dataclass
class TinyAvatar:
    """K = 2: how open the mouth is (0..1), and whether there is a mouth at all (1)."""

    manifest: TinyManifest = field(default_factory=TinyManifest)
    folder: Path = Path()
    rest: NDArray[np.float32] = field(default_factory=lambda: np.array([0, 1], np.float32))
    befores: list[NDArray[np.float32]] = field(default_factory=list)
    sounds: deque[Sound] = field(default_factory=lambda: deque(maxlen=16))
    recognised: deque[bool] = field(default_factory=lambda: deque(maxlen=16))
    delay: float = 0.0
    renderer: str = "puppet"
    model: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(name="puppet"))

    def trajectory(
        self,
        phones: Sequence[Phone],
        frames: int,
        *,
        before: NDArray[np.float32] | None = None,
        sound: Sound | None = None,
        recognised: bool = False,
    ) -> NDArray[np.float32]:
        assert sound is not None
        self.sounds.append(sound)
        self.recognised.append(recognised)
        assert before is not None
        assert before.shape == (8, 2)
        self.befores.append(before)
        rows = np.ones((frames, 2), np.float32)
        for n in range(frames):
            symbol = next((p.symbol for p in phones if p.start <= n / FPS < p.end), SILENCE)
            rows[n, 0] = symbol != SILENCE
        if len(phones) == 1 and phones[0].symbol == SILENCE and frames and before[-1, 0] > 0:
            rows[:, 0] = before[-1, 0] * np.linspace(1, 0, frames + 1)[1:]  # closes gradually
        return rows

    def render(self, coefficients: NDArray[np.float32] | None, loop_frame: int, out: NDArray[np.uint8]) -> None:
        time.sleep(self.delay)
        out[:SIZE] = 128
        out[SIZE:] = 128
        opening = 0.0 if coefficients is None else float(coefficients[0])
        out[: SIZE // 2] = BACKGROUND + round(opening * (OPEN - BACKGROUND))
        out[SIZE // 2 : SIZE] = 30 + 4 * (loop_frame % 50)


def speech(*phones: tuple[str, float], rate: int = RATE) -> Speech:
    """Phones of so many seconds each: a tone for every phone, nothing for SIL."""
    edges = np.round(np.cumsum([0.0, *(seconds for _, seconds in phones)]) * rate).astype(int)
    time_axis = np.arange(edges[-1]) / rate
    samples = (0.4 * np.sin(2 * np.pi * 440 * time_axis)).astype(np.float32)
    made = []
    for (symbol, _), start, end in zip(phones, edges[:-1], edges[1:], strict=True):
        if symbol == SILENCE:
            samples[start:end] = 0
        made.append(Phone(symbol, start / rate, end / rate))
    return Speech(samples, rate, tuple(made))


class TinyNarrator:
    """Every word of the text is a piece: a number of seconds of sound, then 0.1 s of silence; "!" fails there.

    `gate`: if given, the piece of every "|" waits for it.
    """

    def __init__(self) -> None:
        self.gate = threading.Event()
        self.spoken: list[str] = []

    def __call__(self, text: str, reading: Reading) -> Script:  # noqa: ARG002
        if not text.strip():
            raise NothingToSay("nothing")
        return Script(self._speak(text.split()), ("☃",) if "☃" in text else ())

    def _speak(self, words: list[str]) -> Iterator[Speech]:
        for word in words:
            if word == "!":
                raise RuntimeError("the engine broke")
            if word == "|":
                assert self.gate.wait(PATIENCE)
                continue
            self.spoken.append(word)
            yield speech(("AA", float(word)), (SILENCE, 0.1))


async def until(condition: Callable[[], Any]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "never happened"
        await asyncio.sleep(0.005)


@dataclass
class Seen:
    """A decoded file or stream.

    Attributes:
        times: of the pictures, seconds.
        upper, lower: mean luma of the two halves of each picture.
        sound: mono samples, from `sound_start` seconds on, at 48 kHz.
        keyframes: of each picture.
    """

    times: NDArray[np.float64]
    upper: NDArray[np.float64]
    lower: NDArray[np.float64]
    sound: NDArray[np.float32]
    sound_start: float
    keyframes: list[bool]

    @property
    def video_end(self) -> float:
        return float(self.times[-1]) + 1 / FPS

    @property
    def sound_end(self) -> float:
        return self.sound_start + len(self.sound) / 48_000

    def loud(self, frame_time: float) -> float:
        """Root mean square of the 40 ms from `frame_time` on."""
        first = round((frame_time - self.sound_start) * 48_000)
        part = self.sound[max(0, first) : max(0, first) + 1920]
        return float(np.sqrt(np.mean(part**2))) if len(part) else 0.0


def watch_file(file: Any, format: str | None = None) -> Seen:
    """Decode everything."""
    times, upper, lower, keyframes = [], [], [], []
    sound: list[NDArray[np.float32]] = []
    start: float | None = None
    with av.open(file, format=format) as container:
        for packet in container.demux():
            for frame in packet.decode():
                if isinstance(frame, av.VideoFrame):
                    luma = frame.to_ndarray()[:SIZE]
                    times.append(float(frame.time))
                    upper.append(luma[: SIZE // 2].mean())
                    lower.append(luma[SIZE // 2 :].mean())
                    keyframes.append(bool(frame.key_frame))
                else:
                    start = float(frame.time) if start is None else start
                    sound.append(frame.to_ndarray()[0])
    joined = np.concatenate(sound) if sound else np.zeros(0, np.float32)
    return Seen(np.array(times), np.array(upper), np.array(lower), joined, start or 0.0, keyframes)
