"""A WHIP server for the tests: a little HTTP around aiortc, which knows nothing of the publisher's code."""

from __future__ import annotations

import asyncio
import re
from typing import Any

import numpy as np
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError

TOKEN = "let-me-in"


class WhipServer:
    """Takes whoever brings the token, on /whip.

    Attributes:
        requests: lines like "POST /whip" with the answer's status.
        pictures: of each frame its time and its luma.
        sound: of each piece its time and its samples (mono).
        always: if set, the status and body of every answer.
        unreachable: it answers with an address where nobody is.
        location: of the session that it makes.
    """

    def __init__(self) -> None:
        self.requests: list[tuple[str, int]] = []
        self.pictures: list[tuple[float, Any]] = []
        self.sound: list[tuple[float, Any]] = []
        self.always: tuple[int, str] | None = None
        self.unreachable = False
        self.location = "/whip/1"
        self._connections: list[RTCPeerConnection] = []
        self._tasks: list[asyncio.Task[None]] = []
        self._server: asyncio.Server | None = None
        self._port = 0

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._port}/whip"

    async def start(self) -> None:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self._port)
        self._port = self._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        """Gone, connections too; may be started again."""
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()
        await asyncio.gather(*(connection.close() for connection in self._connections))
        for task in self._tasks:
            task.cancel()  # aiortc does not end the tracks of a connection that never came about
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._connections.clear()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode()
        first, *lines = head.split("\r\n")
        headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        body = await reader.readexactly(int(headers.get("content-length", 0)))
        method, path, _ = first.split()
        status, answer = 200, ""
        if headers.get("authorization") != f"Bearer {TOKEN}":
            status = 401
        elif self.always is not None:
            status, answer = self.always
        elif (method, path) == ("POST", "/whip"):
            assert headers["content-type"] == "application/sdp"
            status, answer = 201, await self._answer(body.decode())
        self.requests.append((f"{method} {path}", status))
        writer.write(
            f"HTTP/1.1 {status} -\r\nContent-Type: application/sdp\r\nLocation: {self.location}\r\n"
            f"Content-Length: {len(answer)}\r\nConnection: close\r\n\r\n{answer}".encode()
        )
        await writer.drain()
        writer.close()
        await writer.wait_closed()

    async def _answer(self, offer: str) -> str:
        connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self._connections.append(connection)
        connection.on("track", lambda track: self._tasks.append(asyncio.create_task(self._receive(track))))
        await connection.setRemoteDescription(RTCSessionDescription(offer, "offer"))
        await connection.setLocalDescription(await connection.createAnswer())
        sdp = str(connection.localDescription.sdp)
        if self.unreachable:  # nor may its own checks reveal where it is
            await connection.close()
            sdp = re.sub(r"(a=candidate:\S+ \d udp \d+) \S+", r"\1 127.0.0.1", sdp)
        return sdp

    async def ask_for_a_key_frame(self) -> None:
        for receiver in self._connections[-1].getReceivers():
            if receiver.track.kind == "video":
                await receiver._send_rtcp_pli(receiver.getSynchronizationSources()[0].source)

    async def _receive(self, track: Any) -> None:
        try:
            while True:
                frame = await track.recv()
                if track.kind == "video":
                    self.pictures.append((frame.time, frame.to_ndarray(format="gray")))
                else:
                    samples = frame.to_ndarray().reshape(-1, len(frame.layout.channels))[:, 0]
                    self.sound.append((frame.time, samples.astype(np.float32) / 32_768))
        except MediaStreamError:
            pass
