"""Watching a stream over HTTP: FLV, fragmented MP4, the finished video, and its events."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Collection
from contextlib import aclosing
from typing import Annotated, Any, Literal

import structlog
from fastapi import APIRouter, Query, Request
from fastapi.responses import FileResponse, Response, StreamingResponse
from sse_starlette import EventSourceResponse
from starlette.types import Send

from app.api.service import LoadedService
from app.errors import Gone, InputError
from app.stream.events import EVENT_NAMES, EventName
from app.stream.live import LiveStream

SEND_SECONDS = 30.0
"""A viewer that takes nothing for so long has gone without saying so."""

PING_SECONDS = 15
"""How often an event stream with nothing to say shows that it lives."""

_NO_STORE = {"Cache-Control": "no-store"}
_LIVE_TYPES = {"flv": "video/x-flv", "mp4": "video/mp4"}

_log = structlog.get_logger("mary.api")

router = APIRouter(prefix="/v1/streams/{stream_id}", tags=["watch"])


class LiveResponse(StreamingResponse):
    """Bytes for as long as the stream lives and the viewer takes them; the viewer is let go on every way out."""

    body_iterator: AsyncIterator[bytes]

    async def stream_response(self, send: Send) -> None:
        """Send the headers at once, then what the stream gives."""
        await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
        chunks: Any = self.body_iterator
        async with aclosing(chunks):
            async for chunk in chunks:
                try:
                    async with asyncio.timeout(SEND_SECONDS):
                        await send({"type": "http.response.body", "body": chunk, "more_body": True})
                except TimeoutError:
                    _log.info("a viewer took nothing and is let go", seconds=SEND_SECONDS)
                    return  # the answer is not complete; the server closes the connection
        await send({"type": "http.response.body", "body": b"", "more_body": False})


@router.head("/live.flv", include_in_schema=False)
@router.get("/live.flv", response_class=StreamingResponse)
async def live_flv(stream_id: str, request: Request, service: LoadedService) -> Response:
    """The stream as HTTP-FLV (H.264 and AAC), from the last key frame on: ffplay, VLC, mpegts.js."""
    return _live(service.streams.get(stream_id), "flv", request)


@router.head("/live.mp4", include_in_schema=False)
@router.get("/live.mp4", response_class=StreamingResponse)
async def live_mp4(stream_id: str, request: Request, service: LoadedService) -> Response:
    """The stream as fragmented MP4 (H.264 and AAC), from the last key frame on: Media Source Extensions, VLC."""
    return _live(service.streams.get(stream_id), "mp4", request)


def _live(stream: LiveStream, format: Literal["flv", "mp4"], request: Request) -> Response:
    if stream.state == "ended":
        raise Gone("the stream has ended", advice="The finished video is at video.mp4.")
    media_type = _LIVE_TYPES[format]
    if request.method == "HEAD":  # asking what it is does not make a viewer
        return Response(headers=_NO_STORE, media_type=media_type)
    return LiveResponse(stream.watch(format), headers=_NO_STORE, media_type=media_type)


@router.head("/video.mp4", include_in_schema=False)
@router.get("/video.mp4", response_class=FileResponse)
async def video(
    stream_id: str, service: LoadedService, utterance: Annotated[str | None, Query(max_length=200)] = None
) -> FileResponse:
    """The finished file of the last utterance, or of the one named. `Range` works. 409 while it is being made."""
    path = service.streams.get(stream_id).video(utterance)
    return FileResponse(
        path, media_type="video/mp4", headers=_NO_STORE, filename="mary.mp4", content_disposition_type="inline"
    )


@router.get("/events", response_class=EventSourceResponse)
async def events(
    stream_id: str,
    service: LoadedService,
    types: Annotated[str, Query(max_length=200, description="Names of the events wanted, with commas; all.")] = "",
) -> EventSourceResponse:
    """Server-sent events: state, speak_started, word, viseme, speak_ended, push, error."""
    stream = service.streams.get(stream_id)
    names = event_names(types)
    if stream.state == "ended":
        raise Gone("the stream has ended")
    return EventSourceResponse(_events(stream, names), ping=PING_SECONDS)


def event_names(types: str) -> Collection[EventName]:
    """The events that a comma-separated list names, all for an empty one; InputError if it names another."""
    wanted = {name.strip() for name in types.split(",") if name.strip()}
    unknown = sorted(wanted - set(EVENT_NAMES))
    if unknown:
        raise InputError(
            f"no event is called {unknown[0]!r}", field="types", advice=f"Known: {', '.join(EVENT_NAMES)}."
        )
    return [name for name in EVENT_NAMES if not wanted or name in wanted]


async def _events(stream: LiveStream, names: Collection[EventName]) -> AsyncIterator[dict[str, str]]:
    async for event in stream.events(names):
        yield {"event": event.name, "data": json.dumps(event.data)}


@router.get("/captions.vtt", response_class=Response)
async def captions(
    stream_id: str,
    service: LoadedService,
    utterance: Annotated[str | None, Query(max_length=200)] = None,
    live: Annotated[bool, Query(description="Go on until the stream ends.")] = False,
) -> Response:
    """What was said, with the time of every word: on the stream's clock, or (`utterance`) on that of its video.mp4."""
    stream = service.streams.get(stream_id)
    if not live:
        return Response(stream.captions(utterance), headers=_NO_STORE, media_type="text/vtt")
    if utterance is not None:
        raise InputError("captions of one utterance are not live", field="live", advice="Leave one of the two out.")
    if stream.state == "ended":
        raise Gone("the stream has ended", advice="Its captions are there without live.")
    return LiveResponse(_encoded(stream.live_captions()), headers=_NO_STORE, media_type="text/vtt")


async def _encoded(parts: AsyncIterator[str]) -> AsyncIterator[bytes]:
    async with aclosing(parts):  # type: ignore[type-var]
        async for part in parts:
            yield part.encode()
