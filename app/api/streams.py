"""Streams: make one, let it speak, cut it short, look at it, end it."""

from __future__ import annotations

import time
from typing import Annotated

from fastapi import APIRouter, Body, Depends, Response

from app.api.bodies import takes_json
from app.api.pushes import entries, targets
from app.api.schemas import (
    Frames,
    IdleClip,
    MediaTimes,
    Phase,
    Said,
    SayAccepted,
    SayRequest,
    ShownRequest,
    StreamCreated,
    StreamReport,
    StreamRequest,
    Urls,
    UtteranceReport,
    Viewers,
)
from app.api.service import LoadedService
from app.stream.live import LiveStream, StreamOptions
from app.stream.timeline import IdlePhase
from app.stream.utterance import Reading, Utterance

router = APIRouter(prefix="/v1/streams", tags=["streams"])
_JSON = [Depends(takes_json)]


@router.post("", status_code=201, dependencies=_JSON)
async def create(
    service: LoadedService, response: Response, order: Annotated[StreamRequest | None, Body()] = None
) -> StreamCreated:
    """A new stream. Its address is the key to it: 128 random bits."""
    order = order or StreamRequest()
    if order.text is not None:  # what will be refused must be so before there is a stream
        service.check_length(order.text)
        planned = service.plan(order.text, _reading(order, ""))
    avatar = await service.avatar(order.avatar, trajectory=order.trajectory, renderer=order.renderer)
    voice = service.voice(order.voice, avatar)
    pushes, rtmp = targets(order, service.settings.push)
    stream = service.streams.create(
        avatar,
        voice=voice.id,
        options=StreamOptions(start=order.start, idle=order.idle, once=order.once),
        phase=_phase(order.phase),
        pushes=pushes,
    )
    utterance = None
    if order.text is not None:
        script = service.script(planned, _reading(order, voice.id))
        utterance = stream.speak(script, len(order.text), phase=_phase(order.phase))
    here = f"/v1/streams/{stream.id}"
    response.headers.update({"Location": here, "Cache-Control": "no-store"})
    manifest = avatar.manifest
    return StreamCreated(
        id=stream.id,
        state=stream.state,
        avatar=manifest.id,
        trajectory=avatar.model.name,
        renderer=avatar.renderer,
        voice=voice.id,
        urls=Urls(
            self=here,
            whep=f"{here}/whep",
            flv=f"{here}/live.flv",
            mp4=f"{here}/live.mp4",
            video=f"{here}/video.mp4",
            captions=f"{here}/captions.vtt",
            events=f"{here}/events",
            ws=f"{here}/ws",
            rtmp=rtmp,
        ),
        pushes=entries(stream.report().pushes),
        utterance=_said(utterance) if utterance else None,
        idle=IdleClip(
            url=f"/v1/avatars/{manifest.id}/idle.mp4",
            fps=manifest.fps,
            frames=manifest.loop_frames,
            width=manifest.width,
            height=manifest.height,
        ),
        server_time_ms=_now_ms(),
    )


@router.post("/{stream_id}/say", status_code=202, dependencies=_JSON)
async def say(stream_id: str, order: SayRequest, service: LoadedService) -> SayAccepted:
    """Say more: after what is being said, or (`interrupt`) instead of it."""
    stream = service.streams.get(stream_id)
    service.check_length(order.text)
    voice = service.voice(order.voice, stream.avatar).id if order.voice else ""
    face = await service.face(stream.avatar, order.trajectory, order.renderer)
    utterance = stream.say(
        order.text, interrupt=order.interrupt, reading=_reading(order, voice), phase=_phase(order.phase), face=face
    )
    return SayAccepted(utterance=_said(utterance), server_time_ms=_now_ms())


@router.post("/{stream_id}/interrupt", status_code=202, dependencies=_JSON)
async def interrupt(stream_id: str, service: LoadedService) -> dict[str, str]:
    """Cut short what is being said and forget what is queued."""
    service.streams.get(stream_id).interrupt()
    return {}


@router.get("/{stream_id}")
async def report(stream_id: str, service: LoadedService, response: Response) -> StreamReport:
    """State, viewers, utterances with their timings, frames."""
    response.headers["Cache-Control"] = "no-store"
    return _report(service.streams.get(stream_id))


@router.delete("/{stream_id}", status_code=204, response_class=Response)
async def end(stream_id: str, service: LoadedService) -> Response:
    """End the stream: its viewers see the end of the file. Its finished videos are deleted."""
    await service.streams.end(stream_id)
    return Response(status_code=204)


@router.post("/{stream_id}/utterances/{utterance}/shown", status_code=204, dependencies=_JSON, response_class=Response)
async def shown(stream_id: str, utterance: str, order: ShownRequest, service: LoadedService) -> Response:
    """The browser's report of when it showed the first live frame."""
    service.streams.get(stream_id).shown(utterance, order.milliseconds)
    return Response(status_code=204)


def _phase(phase: Phase | None) -> IdlePhase | None:
    return IdlePhase(phase.frame, phase.at_ms) if phase else None


def _reading(order: StreamRequest | SayRequest, voice: str) -> Reading:
    return Reading(voice, order.speed, order.lexicon, order.strict, order.markup)


def _said(utterance: Utterance) -> Said:
    return Said(id=utterance.id, unread=list(utterance.unread), guessed=list(utterance.guessed))


def _report(stream: LiveStream) -> StreamReport:
    report = stream.report()
    return StreamReport(
        id=report.id,
        state=report.state,
        idle=stream.options.idle,
        avatar=report.avatar,
        trajectory=report.trajectory,
        renderer=report.renderer,
        voice=report.voice,
        viewers=Viewers(**report.viewers),
        pushes=entries(report.pushes),
        utterances=[
            UtteranceReport(
                id=utterance.id,
                state=utterance.state,
                characters=utterance.characters,
                unread=list(utterance.unread),
                guessed=list(utterance.guessed),
                media=MediaTimes(start=utterance.media[0], end=utterance.media[1]) if utterance.media else None,
                timings=dict(utterance.timings.items()),
                error=utterance.error or None,
            )
            for utterance in report.utterances
        ],
        frames=Frames(rendered=report.rendered, dropped=report.dropped),
        server_time_ms=_now_ms(),
    )


def _now_ms() -> float:
    return time.time() * 1000
