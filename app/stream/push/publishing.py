"""The parent's side of a publishing process (`app.stream.push.process`): started, fed, listened to, killed."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.stream.broadcast import Broadcast, Subscription
from app.stream.packet import Kind, Packet
from app.stream.push.pipe import PublishOrder, pack_packet

END_SECONDS = 0.8
"""How long a server may take to the end of a stream before the process is killed."""
MARGIN_SECONDS = 3.0
"""The process ends by its own alarm; so much later it is killed."""

_ROOT = Path(__file__).resolve().parents[2]


class Broken(Exception):
    """A process that ended before the stream did.

    Only `Push` gets it, and makes a state of it: nobody is answered with it, so it is not in the tree of `app.errors`.

    Args:
        message: why, in words of ours.
        detail: the server's own words, which may hold what is not to be shown.
        refused: the server was there and refused to be published to.
    """

    def __init__(self, message: str, detail: str = "", *, refused: bool = False) -> None:
        super().__init__(message)
        self.message = message
        self.detail = detail
        self.refused = refused


class Publishing:
    """One process from its start to its end, and then perhaps another. On one event loop.

    Args:
        order: what it is to do.
        source: what is published.
        kinds: of packets it gets.
        request_keyframe: called when a key frame is needed.
    """

    def __init__(
        self, order: PublishOrder, source: Broadcast[Packet], kinds: set[Kind], request_keyframe: Callable[[], None]
    ) -> None:
        self._order = order
        self._source = source
        self._kinds = kinds
        self._request_keyframe = request_keyframe
        self._live = False
        self._subscription: Subscription[Packet] | None = None

    async def run(self, on_live: Callable[[], None]) -> None:
        """Publish until the source or `finish`; leaves no process, however it ends.

        Args:
            on_live: called when the server lets the stream be published.

        Raises:
            Broken: it ended before.
        """
        self._live = False
        found = [str(_ROOT), os.environ.get("PYTHONPATH", "")]
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-P",
            "-m",
            "app.stream.push.process",
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, found))},
        )
        assert process.stdin is not None
        try:
            process.stdin.write(self._order.pack())
            answer: dict[str, Any] = {}
            with contextlib.suppress(TimeoutError):
                # Twice: a server may take its time over the request, and again over the connection for the media.
                async with asyncio.timeout(2 * self._order.stall_seconds + MARGIN_SECONDS):
                    answer = await self._answer(process)
            if not answer.get("live"):
                raise await self._broken(process, answer)
            self._live = True
            with self._source.subscribe(self._kinds, backlog=False) as packets:
                self._subscription = packets
                self._request_keyframe()
                on_live()  # speech that has waited for this begins now, and must not be missed
                await self._feed(process, packets)
        finally:
            self._subscription = None
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            process.stdin.close()
            await process.communicate()  # it is gone at once, and leaves neither a zombie nor open files

    def finish(self) -> None:
        """Send no more; the server is told, and `run` returns."""
        if self._subscription is not None:
            self._subscription.close()

    async def _feed(self, process: asyncio.subprocess.Process, packets: Subscription[Packet]) -> None:
        assert process.stdin is not None
        ended = asyncio.create_task(self._answer(process))
        sending = asyncio.create_task(self._send(process.stdin, packets))
        try:
            await asyncio.wait({ended, sending}, return_when=asyncio.FIRST_COMPLETED)
            if not sending.done():
                raise await self._broken(process, ended.result())
            await sending
            await asyncio.wait({ended}, timeout=END_SECONDS)  # it says goodbye to the server
        finally:
            for task in (ended, sending):
                task.cancel()
            await asyncio.gather(ended, sending, return_exceptions=True)

    async def _send(self, pipe: asyncio.StreamWriter, packets: Subscription[Packet]) -> None:
        cuts = 0
        try:
            async for packet in packets:
                if packets.cuts != cuts:
                    cuts = packets.cuts
                    self._request_keyframe()
                pipe.write(pack_packet(packet))
                async with asyncio.timeout(self._order.stall_seconds + MARGIN_SECONDS):
                    await pipe.drain()
        except TimeoutError:
            raise Broken("the server takes nothing") from None
        except ConnectionError:
            await asyncio.sleep(MARGIN_SECONDS)  # meanwhile its last words tell why
            raise Broken("the publishing process takes nothing") from None
        if packets.slow:
            raise Broken("the server takes less than the stream's bit rate")
        pipe.close()

    async def _answer(self, process: asyncio.subprocess.Process) -> dict[str, Any]:
        """What the process says next, but for requests of key frames; empty when it has ended."""
        assert process.stdout is not None
        while line := await process.stdout.readline():
            answer: dict[str, Any] = json.loads(line)
            if not answer.get("keyframe"):
                return answer
            self._request_keyframe()
        await process.wait()
        return {}

    async def _broken(self, process: asyncio.subprocess.Process, answer: dict[str, Any]) -> Broken:
        if "error" in answer:
            with contextlib.suppress(TimeoutError):  # a WHIP server is told, if it can be
                async with asyncio.timeout(END_SECONDS):
                    await process.wait()
            return Broken(answer["error"], answer["detail"], refused=answer["refused"])
        if process.returncode is None or process.returncode == -signal.SIGALRM:
            done = "taken" if self._live else "answered"
            return Broken(f"the server has {done} nothing for {self._order.stall_seconds:g} s")
        return Broken(f"the publishing process ended with {process.returncode}")
