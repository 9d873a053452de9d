"""A text as a finished file in the answer: no stream, no waiting for the clock."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

from fastapi import APIRouter, Depends, Request
from fastapi.responses import FileResponse, Response
from starlette.types import Receive, Scope, Send

from app.api.schemas import RenderRequest
from app.api.service import LoadedService, Service
from app.api.streams import takes_json
from app.api.threads import in_thread
from app.engine.avatar import Avatar
from app.errors import OverCapacity
from app.speech import Speech
from app.stream.render import render_file
from app.tts.narrate import Plan, narrate, plan

router = APIRouter(prefix="/v1", tags=["render"])

UNREAD_HEADER = "Mary-Unread"
"""What of the text could not be read aloud, percent-encoded and separated by commas; the body is the file."""
UNREAD_MOST = 2048
"""Characters of that header: proxies refuse long ones."""


class _AbandonedError(Exception):
    """Nobody waits for the file any more."""


class OnceFile(FileResponse):
    """A file that is sent once; its folder is deleted afterwards, however sending ended."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send and delete."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            shutil.rmtree(Path(self.path).parent, ignore_errors=True)


@router.post("/render", dependencies=[Depends(takes_json)], response_class=FileResponse)
async def render(order: RenderRequest, request: Request, service: LoadedService) -> Response:
    """Speak a text into an MP4 file, as fast as the machine can. When the caller hangs up, the work stops."""
    service.check_length(order.text)
    planned = plan(order.text)
    avatar = await service.avatar(order.avatar)
    voice = service.voice(order.voice, avatar).id
    work = asyncio.create_task(_render(service, avatar, planned, voice, order.speed))
    gone = asyncio.create_task(_hung_up(request))
    closing = asyncio.create_task(service.closing.wait())
    try:
        await asyncio.wait({work, gone, closing}, return_when=asyncio.FIRST_COMPLETED)
        if work.done():
            headers = {"Cache-Control": "no-store"}
            if planned.unread:
                headers[UNREAD_HEADER] = ", ".join(quote(piece, safe="") for piece in planned.unread)[:UNREAD_MOST]
            return OnceFile(work.result(), media_type="video/mp4", headers=headers, filename="mary.mp4")
        if closing.done():
            raise OverCapacity("the service is stopping", advice="Try again in a moment.")
        return Response(status_code=499)  # reaches nobody; the log shows it
    finally:
        for task in (work, gone, closing):
            task.cancel()
        await asyncio.gather(work, gone, closing, return_exceptions=True)


async def _render(service: Service, avatar: Avatar, planned: Plan, voice: str, speed: float) -> Path:
    """A finished file in a folder of its own; the folder is gone again if this is cancelled or fails."""
    abandoned = threading.Event()

    def go_on(_frames: int) -> None:
        if abandoned.is_set():
            raise _AbandonedError

    def speeches() -> Iterator[Speech]:
        for speech in narrate(service.engine, planned, voice=voice, speed=speed):
            go_on(0)
            yield speech

    def work(path: Path) -> None:
        try:
            render_file(avatar, speeches(), service.settings, path, service.pool, on_frame=go_on)
        finally:
            if abandoned.is_set():
                shutil.rmtree(path.parent, ignore_errors=True)

    async with service.render_turns:
        path = Path(tempfile.mkdtemp(prefix="mary-render-")) / "mary.mp4"
        try:
            await in_thread(work, path)
        except BaseException:
            abandoned.set()
            shutil.rmtree(path.parent, ignore_errors=True)
            raise
    return path


async def _hung_up(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
