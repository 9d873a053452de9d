"""The caller's own recording instead of a voice: spoken by a stream, or made a file of."""

from __future__ import annotations

import time
from typing import Annotated

from fastapi import APIRouter, Depends, Form, Request
from fastapi.responses import FileResponse, Response
from fastapi.routing import APIRoute
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.routing import Match
from starlette.types import Scope

from app.align.listen import Listened, cut
from app.api.middleware import FORM
from app.api.render import GUESSED_HEADER, listed, send_rendered
from app.api.schemas import Recorded, RecordingAccepted, RecordingRequest, RenderRecordingRequest
from app.api.service import LoadedService
from app.stream.utterance import Script

CONFIDENCE_HEADER = "Mary-Confidence"
"""How well the text fits, 0 to 1."""


def carries_form(scope: Scope) -> bool:
    """Whether a request says that its body is multipart/form-data, and can be one."""
    kind, _, parameters = Headers(scope=scope).get("content-type", "").partition(";")
    return kind.strip().lower() == FORM and "boundary=" in parameters.lower()


class FormRoute(APIRoute):
    """A route that takes forms, beside one at the same address that takes JSON."""

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """No match for what is no form."""
        match, child = super().matches(scope)
        return (match, child) if match is not Match.FULL or carries_form(scope) else (Match.NONE, {})


async def own_or_allowed(request: Request) -> None:
    """Refuse forms of foreign pages, which a browser sends without asking, unlike JSON."""
    headers = request.headers
    allowed = request.app.state.service.settings.server.cors_origins
    if _foreign(headers) and not {"*", headers.get("origin", "")} & set(allowed):
        raise HTTPException(403, "pages of other origins may not send forms")


def _foreign(headers: Headers) -> bool:
    """Whether a page of another origin sends this; programs say nothing of either kind."""
    site = headers.get("sec-fetch-site", "none")
    if site != "none":  # the browser's own word also counts behind a proxy that changes Host
        return site != "same-origin"
    origin = headers.get("origin")  # all there is of older browsers, and of any to http:// addresses
    return origin is not None and origin.partition("://")[2].lower() != headers.get("host", "").lower()


async def takes_form(request: Request) -> None:
    """Refuse bodies that are no form, for what they lack as one would mislead."""
    if not carries_form(request.scope):
        kind = request.headers.get("content-type", "").partition(";")[0].strip()
        raise HTTPException(
            415, f"the body must be {FORM}, not {kind or 'nothing'} (curl: -F audio=@speech.wav -F text=…)"
        )


router = APIRouter(prefix="/v1", dependencies=[Depends(own_or_allowed)])
forms = APIRouter(prefix="/v1", route_class=FormRoute, dependencies=[Depends(own_or_allowed)])


@router.post("/streams/{stream_id}/audio", status_code=202, tags=["streams"], dependencies=[Depends(takes_form)])
async def speak(
    stream_id: str, order: Annotated[RecordingRequest, Form(media_type=FORM)], service: LoadedService
) -> RecordingAccepted:
    """Say a recording: after what is being said, or (`interrupt`) instead of it."""
    stream = service.streams.get(stream_id)
    face = await service.face(stream.avatar, order.trajectory, order.renderer)
    service.check_length(order.text)
    listened = await service.listening.recording(
        order.audio.file, order.text, strict=order.strict, lexicon=order.lexicon
    )
    script = Script(cut(listened.speech), guessed=listened.guessed)
    utterance = stream.speak(script, len(order.text), interrupt=order.interrupt, face=face)
    return RecordingAccepted(
        utterance=Recorded(
            id=utterance.id,
            unread=[],
            guessed=list(listened.guessed),
            confidence=None if listened.confidence is None else round(listened.confidence, 2),
            doubtful=listened.doubtful,
        ),
        server_time_ms=time.time() * 1000,
    )


@forms.post("/render", response_class=FileResponse, include_in_schema=False)
async def render(
    order: Annotated[RenderRecordingRequest, Form(media_type=FORM)], request: Request, service: LoadedService
) -> Response:
    """Speak a recording into an MP4 file, as fast as the machine can. When the caller hangs up, the work stops."""
    service.check_length(order.text)
    avatar = await service.avatar(order.avatar, trajectory=order.trajectory, renderer=order.renderer)
    listened = await service.listening.recording(
        order.audio.file, order.text, strict=order.strict, lexicon=order.lexicon
    )
    return await send_rendered(request, service, avatar, lambda: cut(listened.speech), _headers(listened))


def _headers(listened: Listened) -> dict[str, str]:
    headers = {}
    if listened.confidence is not None:
        headers[CONFIDENCE_HEADER] = f"{listened.confidence:.2f}"
    if listened.guessed:
        headers[GUESSED_HEADER] = listed(listened.guessed)
    return headers
