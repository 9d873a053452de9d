"""The page: plain files, sent as they are."""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter, FastAPI
from fastapi.responses import FileResponse, RedirectResponse
from starlette.responses import Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from app.errors import NotFound

FOLDER = Path(__file__).resolve().parents[2] / "static"

_CHECK_FIRST = {"Cache-Control": "no-cache"}
"""Browsers may keep the files, but ask whether they have changed: after an update nobody runs half of the old page."""

_POLICY = "default-src 'self'; media-src 'self' blob:; img-src 'self' data:; object-src 'none'; frame-ancestors 'self'"
"""The page needs nothing from anywhere else; its live video comes from a MediaSource, which has a blob: address."""

_FOR_ANY_PAGE = {"Access-Control-Allow-Origin": "*"}
"""The files are public, and a page of another site that embeds the avatar imports them as modules."""

router = APIRouter(include_in_schema=False)


@router.head("/", include_in_schema=False)
@router.get("/")
async def index() -> FileResponse:
    """The page itself."""
    file = FOLDER / "index.html"
    if not file.is_file():
        raise NotFound("the page is not installed", advice="Start the service from the repository: make serve.")
    return FileResponse(file, headers=_CHECK_FIRST | {"Content-Security-Policy": _POLICY})


@router.head("/mary.js", include_in_schema=False)
@router.get("/mary.js")
async def component() -> RedirectResponse:
    """The web component by a short address; modules it imports are found beside the long one."""
    return RedirectResponse("static/mary.js", headers=_CHECK_FIRST | _FOR_ANY_PAGE)


def mount(app: FastAPI) -> None:
    """Serve the page's files under /static."""
    app.mount("/static", _Files(directory=FOLDER, check_dir=False), name="static")


class _Files(StaticFiles):
    async def get_response(self, path: str, scope: Scope) -> Response:
        response = await super().get_response(path, scope)
        response.headers.update(_CHECK_FIRST | _FOR_ANY_PAGE)
        return response
