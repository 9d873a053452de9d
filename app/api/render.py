"""A text as a finished file in the answer: no stream, no waiting for the clock."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from urllib.parse import quote

from fastapi import APIRouter, Depends, Request
from fastapi.responses import FileResponse, Response
from starlette.types import Receive, Scope, Send

from app.api.bodies import takes_json
from app.api.schemas import RenderRequest
from app.api.service import LoadedService, Service
from app.api.threads import in_thread
from app.engine.avatar import Avatar
from app.errors import OverCapacity
from app.speech import Speech
from app.stream.render import render_file
from app.stream.utterance import Reading
from app.tts.narrate import narrate

router = APIRouter(prefix="/v1", tags=["render"])

UNREAD_HEADER, GUESSED_HEADER = "Mary-Unread", "Mary-Guessed"
"""What of the text could not be read aloud, and words that no dictionary has, as `listed`; the body is the file."""
HEADER_MOST = 2048
"""Characters of a header: proxies refuse long ones."""


def listed(words: Sequence[str]) -> str:
    """Words as a header: percent-encoded and separated by commas."""
    return ", ".join(quote(word, safe="") for word in words)[:HEADER_MOST]


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
    planned = service.plan(order.text, Reading(lexicon=order.lexicon, strict=order.strict, markup=order.markup))
    avatar = await service.avatar(order.avatar, trajectory=order.trajectory, renderer=order.renderer)
    voice = service.voice(order.voice, avatar).id
    headers = {}
    if planned.unread:
        headers[UNREAD_HEADER] = listed(planned.unread)
    if planned.guessed:
        headers[GUESSED_HEADER] = listed(planned.guessed)

    def speeches() -> Iterator[Speech]:
        return narrate(service.engine, planned, voice=voice, speed=order.speed)

    return await send_rendered(request, service, avatar, speeches, headers)


async def send_rendered(
    request: Request,
    service: Service,
    avatar: Avatar,
    speeches: Callable[[], Iterator[Speech]],
    headers: dict[str, str],
) -> Response:
    """The answer that is a finished file.

    Args:
        request: whose caller may hang up.
        service: renders.
        avatar: who speaks.
        speeches: made in the thread that renders; they follow each other without a gap.
        headers: of the answer.

    Raises:
        OverCapacity: too many files are being rendered, or the service is stopping.
        MaryError: what the speeches raise.
    """
    work = asyncio.create_task(_render(service, avatar, speeches))
    gone = asyncio.create_task(_hung_up(request))
    closing = asyncio.create_task(service.closing.wait())
    try:
        await asyncio.wait({work, gone, closing}, return_when=asyncio.FIRST_COMPLETED)
        if work.done():
            return OnceFile(
                work.result(),
                media_type="video/mp4",
                headers={"Cache-Control": "no-store", **headers},
                filename="mary.mp4",
            )
        if closing.done():
            raise OverCapacity("the service is stopping", advice="Try again in a moment.")
        return Response(status_code=499)  # reaches nobody; the log shows it
    finally:
        for task in (work, gone, closing):
            task.cancel()
        await asyncio.gather(work, gone, closing, return_exceptions=True)


async def _render(service: Service, avatar: Avatar, speeches: Callable[[], Iterator[Speech]]) -> Path:
    """A finished file in a folder of its own; the folder is gone again if this is cancelled or fails."""
    abandoned = threading.Event()

    def go_on(_frames: int) -> None:
        if abandoned.is_set():
            raise _AbandonedError

    def wanted() -> Iterator[Speech]:
        for speech in speeches():
            go_on(0)
            yield speech

    def work(path: Path) -> None:
        try:
            render_file(avatar, wanted(), service.settings, path, service.pool, on_frame=go_on)
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
