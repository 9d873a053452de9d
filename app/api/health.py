"""Probes: is the process alive, and can it answer."""

from __future__ import annotations

from fastapi import APIRouter, Request

from app.api.service import Service
from app.errors import OverCapacity

router = APIRouter(tags=["health"])


@router.get("/healthz")
async def healthz() -> dict[str, str]:
    """The process is alive."""
    return {"status": "ok"}


@router.get("/readyz")
async def readyz(request: Request) -> dict[str, str]:
    """Avatars and voices are loaded: 200. Still loading, or ending: 503 with `Retry-After`."""
    service: Service = request.app.state.service
    if not service.ready:
        raise OverCapacity("the service is not ready", advice="Avatars and voices are being loaded, or it is ending.")
    return {"status": "ready"}
