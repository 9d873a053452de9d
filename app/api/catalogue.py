"""What can be used: avatars with their idle clips, and voices."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import FileResponse

from app.api.schemas import AvatarEntry, Avatars, EngineEntry, VoiceEntry, Voices
from app.api.service import LoadedService
from app.api.threads import in_thread
from app.engine.avatar import renderers
from app.engine.models.pack_models import trajectories
from app.tts.voices import every_voice

router = APIRouter(tags=["catalogue"])

_CACHE = {"Cache-Control": "no-cache"}


@router.get("/v1/avatars")
async def avatars(service: LoadedService) -> Avatars:
    """All avatars that can be used; damaged ones are left out."""
    entries = [
        AvatarEntry(
            id=manifest.id,
            title=manifest.title,
            voice=manifest.voice,
            fps=manifest.fps,
            width=manifest.width,
            height=manifest.height,
            idle=f"/v1/avatars/{manifest.id}/idle.mp4",
            preview=f"/v1/avatars/{manifest.id}/preview.jpg",
            trajectories=list(trajectories(manifest)),
            renderers=list(renderers(manifest)),
        )
        for manifest in await in_thread(service.shelf.usable)
    ]
    return Avatars(default=service.settings.avatars.default, avatars=entries)


@router.head("/v1/avatars/{avatar}/idle.mp4", include_in_schema=False)
@router.get("/v1/avatars/{avatar}/idle.mp4", response_class=FileResponse)
async def idle(avatar: str, service: LoadedService) -> FileResponse:
    """The loop that a page shows while nothing is said. `Range` works."""
    return FileResponse(await service.avatar_folder(avatar) / "idle.mp4", media_type="video/mp4", headers=_CACHE)


@router.head("/v1/avatars/{avatar}/preview.jpg", include_in_schema=False)
@router.get("/v1/avatars/{avatar}/preview.jpg", response_class=FileResponse)
async def preview(avatar: str, service: LoadedService) -> FileResponse:
    """A still picture of the avatar."""
    return FileResponse(await service.avatar_folder(avatar) / "preview.jpg", media_type="image/jpeg", headers=_CACHE)


@router.get("/v1/voices")
async def voices(service: LoadedService, all_engines: Annotated[bool, Query(alias="all")] = False) -> Voices:
    """All voices of the speech engine in use, the default one that of the default avatar; or those of all engines."""
    default = service.voice(None, await service.avatar(None))
    if not all_engines:
        shown, engines = service.engine.voices(), None
    else:
        found = await in_thread(every_voice, service.settings.speech.engines)
        shown = tuple(voice for each in found for voice in each.voices)
        engines = [EngineEntry(name=each.engine, missing=each.missing) for each in found]
    entries = [VoiceEntry(**asdict(voice)) for voice in shown]
    return Voices(default=default.id, engine=service.engine.name, voices=entries, engines=engines)
