"""The application: routes, error documents and the service behind them, put together."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version

from fastapi import FastAPI

from app.api import (
    catalogue,
    conversation,
    health,
    latency,
    live,
    page,
    problems,
    pushes,
    recordings,
    render,
    streams,
    whep,
)  # fmt: skip
from app.api.cross_origin import CrossOrigin
from app.api.middleware import BodyLimit, Envelope
from app.api.schemas import Problem
from app.api.service import Service
from app.config import Settings

JSON_BYTES_A_CHARACTER = 12
"""The longest way to write one character in JSON: two escapes of six bytes."""

FORM_BYTES_A_CHARACTER = 4
"""The longest way to write one character in UTF-8."""

OTHER_FIELDS_BYTES = 65_536
"""What the rest of a request may take."""


def create_app(settings: Settings) -> FastAPI:
    """The whole service as an ASGI application. It loads avatars and voices when its lifespan starts."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        service: Service = app.state.service
        service.start()
        yield
        await service.close()

    app = FastAPI(
        title="Mary",
        summary="Text in, a live photoreal talking head out.",
        version=version("mary"),
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        lifespan=lifespan,
        redoc_url=None,
        responses={
            "4XX": {
                "description": "A problem document (RFC 9457)",
                "content": {problems.MEDIA_TYPE: {"schema": Problem.model_json_schema()}},
            }
        },
    )
    app.state.service = Service(settings)
    app.add_middleware(BodyLimit, limit=body_limit(settings), form_limit=form_limit(settings))
    app.add_middleware(Envelope)
    if settings.server.cors_origins:
        app.add_middleware(CrossOrigin, origins=settings.server.cors_origins)
    problems.install(app)
    app.include_router(recordings.forms)  # before the routes at the same addresses that take JSON
    for part in (
        recordings, streams, live, whep, pushes, conversation, render, catalogue, latency, health, problems, page,
    ):  # fmt: skip
        app.include_router(part.router)
    page.mount(app)
    return app


def body_limit(settings: Settings) -> int:
    """Bytes of the longest body or message that can hold anything sensible."""
    return max(settings.limits.text * JSON_BYTES_A_CHARACTER, settings.limits.sdp) + OTHER_FIELDS_BYTES


def form_limit(settings: Settings) -> int:
    """Bytes of the longest form that can hold a recording and its text."""
    return settings.limits.audio_bytes + settings.limits.text * FORM_BYTES_A_CHARACTER + OTHER_FIELDS_BYTES
