"""A session of many minutes on a fast clock; prints what viewers saw as JSON. Run by test_long_session.py.

    python long_session.py MINUTES SPEED SEED

The clock of the whole process runs SPEED times as fast, for everything that asks the time or waits: the service, its
threads and the event loop cannot tell.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import selectors
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

MINUTES, SPEED, SEED = float(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])


def hasten(speed: float) -> None:
    """To be called before anything is imported that keeps a reference to a clock."""
    monotonic, wall, wait = time.monotonic, time.time, threading.Condition.wait
    start, wall_start = monotonic(), wall()
    time.monotonic = lambda: start + speed * (monotonic() - start)
    time.time = lambda: wall_start + speed * (monotonic() - start)

    def hastened_wait(self: threading.Condition, timeout: float | None = None) -> bool:
        return wait(self, None if timeout is None else timeout / speed)

    threading.Condition.wait = hastened_wait  # type: ignore[method-assign]


class FastSelector(selectors.EpollSelector):
    """The event loop's own waiting."""

    def select(self, timeout: float | None = None) -> Any:
        return super().select(None if timeout is None else timeout / SPEED)


hasten(SPEED)

import av  # noqa: E402
import numpy as np  # noqa: E402
from puppet import BACKGROUND, OPEN, SIZE, TinyAvatar, TinyNarrator  # noqa: E402

from app.config import Settings  # noqa: E402
from app.engine.pool import OrderedPool  # noqa: E402
from app.stream.live import LiveStream, StreamOptions  # noqa: E402
from app.stream.timing import LatencyLog  # noqa: E402


class Forgetful(list[Any]):
    """What the puppets remember for other tests would pile up here."""

    def append(self, _: Any) -> None:
        pass


class Viewer:
    """Watches to the end, and looks at it then: what decoders do with memory is not the service's doing.

    Attributes:
        opened: when the mouth opened, seconds of the stream.
        sounded: when sound began after silence.
    """

    def __init__(self, stream: LiveStream, format: Any, path: Path) -> None:
        self.opened: list[float] = []
        self.sounded: list[float] = []
        self.pictures = 0
        self._format = format
        self._path = path
        self._task = asyncio.create_task(self._receive(stream.watch(format)))

    async def _receive(self, chunks: Any) -> None:
        with self._path.open("wb") as file:
            async for chunk in chunks:
                file.write(chunk)

    async def end(self) -> None:
        """Wait for the end of the stream."""
        await self._task

    def look(self) -> dict[str, Any]:
        """How far the beginning of the sound is from every opening of the mouth: (when, seconds) in "offsets"."""
        was_open, quiet_since = False, -1.0
        with av.open(str(self._path), format=self._format) as container:
            for packet in container.demux():
                for frame in packet.decode():
                    if isinstance(frame, av.VideoFrame):
                        is_open = frame.to_ndarray()[: SIZE // 2].mean() > (BACKGROUND + OPEN) / 2
                        if is_open and not was_open:
                            self.opened.append(float(frame.time))
                        was_open = is_open
                        self.pictures += 1
                    else:
                        quiet_since = self._listen(frame, quiet_since)
        sounded = np.array(self.sounded)
        offsets = [(at, float(at - sounded[np.abs(sounded - at).argmin()])) for at in self.opened]
        return {"offsets": offsets, "pictures": self.pictures}

    def _listen(self, frame: Any, quiet_since: float) -> float:
        for n, peak in enumerate(np.abs(frame.to_ndarray()[0]).reshape(-1, 128).max(axis=1)):
            seconds = float(frame.time) + n * 128 / 48_000
            if peak > 0.1:
                if seconds - quiet_since > 0.07:
                    self.sounded.append(seconds)
                quiet_since = seconds
        return quiet_since


def resident() -> float:
    """Megabytes of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


async def converse(stream: LiveStream, chance: random.Random, end: float) -> tuple[int, int]:
    said = interrupted = 0
    while time.monotonic() < end:
        words = " ".join(f"{chance.uniform(0.15, 0.6):.2f}" for _ in range(chance.randint(1, 6)))
        with contextlib.suppress(Exception):  # too much is queued: wait
            stream.say(words, interrupt=chance.random() < 0.15)
            said += 1
        await asyncio.sleep(chance.uniform(0.2, 5.0))
        if chance.random() < 0.2:
            stream.interrupt()
            interrupted += 1
    return said, interrupted


async def main() -> None:
    settings = Settings(stream={"preset": "ultrafast", "keyframe_seconds": 2.0, "queue_seconds": 60.0})
    pool = OrderedPool(2)
    narrator, avatar = TinyNarrator(), TinyAvatar()
    narrator.spoken, avatar.befores = Forgetful(), Forgetful()
    with tempfile.TemporaryDirectory() as folder:
        stream = LiveStream(
            avatar,  # type: ignore[arg-type]
            voice="buzz",
            narrator=narrator,
            pool=pool,
            settings=settings,
            folder=Path(folder),
            latency=LatencyLog(),
            options=StreamOptions(start="now"),
        )
        end = time.monotonic() + 60 * MINUTES
        viewers = {format: Viewer(stream, format, Path(folder) / f"seen.{format}") for format in ("flv", "mp4")}
        memory: list[float] = []

        async def come_and_go() -> None:
            while True:  # a third viewer, who decodes nothing
                chunks: Any = stream.watch("flv")
                leaves = time.monotonic() + 20
                async for _ in chunks:
                    if time.monotonic() > leaves:
                        break
                await chunks.aclose()
                memory.append(resident())

        guests = asyncio.create_task(come_and_go())
        said, interrupted = await converse(stream, random.Random(SEED), end)
        guests.cancel()
        await asyncio.gather(guests, return_exceptions=True)
        states = {report.state for report in stream.report().utterances}
        dropped, rendered = stream.report().dropped, stream.report().rendered
        await stream.end()
        for viewer in viewers.values():
            await viewer.end()
        pool.close()
        threads = [thread.name for thread in threading.enumerate() if not thread.name.startswith("asyncio_")]
        seen = {format: viewer.look() for format, viewer in viewers.items()}
    result = {
        "said": said,
        "interrupted": interrupted,
        "states": sorted(states),
        "rendered": rendered,
        "dropped": dropped,
        "memory": memory,
        "threads": threads,
        "viewers": seen,
    }
    print(json.dumps(result))


with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(FastSelector())) as runner:
    runner.run(main())
