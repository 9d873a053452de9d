"""Pushing a stream to RTMP and WHIP servers."""

from __future__ import annotations

from collections.abc import Iterable

from fastapi import APIRouter, Depends, Response

from app.api.bodies import takes_json
from app.api.schemas import PushEntry, PushRequest, StreamRequest
from app.api.service import LoadedService
from app.config import PushSettings
from app.errors import InputError
from app.stream.push.push import PushReport
from app.stream.push.target import PushTarget, new_key, own_target, push_target, without_credentials

router = APIRouter(prefix="/v1/streams/{stream_id}/pushes", tags=["push"])


@router.post("", status_code=201, dependencies=[Depends(takes_json)])
async def push(stream_id: str, order: PushRequest, service: LoadedService, response: Response) -> PushEntry:
    """Push the stream to a server, too: RTMP or, to an http(s) URL, WHIP."""
    stream = service.streams.get(stream_id)
    target = push_target(order.url, token=order.token or "", hosts=service.settings.push.hosts)
    report = stream.push(target)
    response.headers.update({"Location": f"/v1/streams/{stream_id}/pushes/{report.id}", "Cache-Control": "no-store"})
    return entries([report])[0]


@router.delete("/{push_id}", status_code=204, response_class=Response)
async def end_push(stream_id: str, push_id: str, service: LoadedService) -> Response:
    """End a push; the stream goes on."""
    await service.streams.get(stream_id).end_push(push_id)
    return Response(status_code=204)


def targets(order: StreamRequest, settings: PushSettings) -> tuple[list[PushTarget], str | None]:
    """The targets a new stream is to be pushed to, and where it will play if one is the service's own server.

    Raises:
        InputError: a target is not allowed, or the service has no server of its own.
    """
    found: list[PushTarget] = []
    plays_at = None
    if order.rtmp_url is not None and order.transport == "rtmp":
        raise InputError(
            "transport and rtmp_url name two servers",
            advice="Leave one of them out; a further push: POST …/pushes.",
            field="rtmp_url",
        )
    if order.rtmp_url is not None:
        found.append(push_target(order.rtmp_url, kind="rtmp", hosts=settings.hosts, field="rtmp_url"))
    elif order.transport == "rtmp":
        if not settings.rtmp:
            raise InputError(
                "transport: this service has no RTMP server of its own",
                advice="Give rtmp_url, or have the operator set push.rtmp (MARY_PUSH__RTMP), e.g. rtmp://localhost/live.",
                field="transport",
            )
        key = new_key()
        found.append(own_target(settings.rtmp, key))
        plays_at = f"{without_credentials(settings.rtmp_play or settings.rtmp).rstrip('/')}/{key}"
    if order.whip_url is not None:
        token = order.whip_token or ""
        found.append(push_target(order.whip_url, kind="whip", token=token, hosts=settings.hosts, field="whip_url"))
    elif order.whip_token is not None:
        raise InputError("whip_token without whip_url", field="whip_token")
    return found, plays_at


def entries(reports: Iterable[PushReport]) -> list[PushEntry]:
    """Reports as the API shows them."""
    return [
        PushEntry(
            id=report.id,
            kind=report.kind,
            target=report.target,
            state=report.state,
            error=report.error or None,
            retries=report.retries,
        )
        for report in reports
    ]
