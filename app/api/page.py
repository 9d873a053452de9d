"""The page: plain files, sent as they are."""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter, FastAPI
from fastapi.responses import FileResponse
from starlette.responses import Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from app.errors import NotFound

FOLDER = Path(__file__).resolve().parents[2] / "static"

_CHECK_FIRST = {"Cache-Control": "no-cache"}
"""Browsers may keep the files, but ask whether they have changed: after an update nobody runs half of the old page."""

_POLICY = "default-src 'self'; media-src 'self' blob:; img-src 'self' data:; object-src 'none'; frame-ancestors 'self'"
"""The page needs nothing from anywhere else; its live video comes from a MediaSource, which has a blob: address."""

router = APIRouter(include_in_schema=False)


@router.head("/", include_in_schema=False)
@router.get("/")
async def index() -> FileResponse:
    """The page itself."""
    file = FOLDER / "index.html"
    if not file.is_file():
        raise NotFound("the page is not installed", advice="Start the service from the repository: make serve.")
    return FileResponse(file, headers=_CHECK_FIRST | {"Content-Security-Policy": _POLICY})


def mount(app: FastAPI) -> None:
    """Serve the page's files under /static."""
    app.mount("/static", _Files(directory=FOLDER, check_dir=False), name="static")


class _Files(StaticFiles):
    async def get_response(self, path: str, scope: Scope) -> Response:
        response = await super().get_response(path, scope)
        response.headers.update(_CHECK_FIRST)
        return response
