"""What bodies a route takes."""

from __future__ import annotations

from fastapi import Request
from starlette.exceptions import HTTPException


async def takes_json(request: Request) -> None:
    """Refuse bodies that are not called JSON, which a foreign page could send without asking."""
    content_type = request.headers.get("content-type", "")
    kind = content_type.partition(";")[0].strip().lower()
    empty = request.headers.get("content-length", "0") == "0" and "transfer-encoding" not in request.headers
    if kind == "application/json" or (empty and not kind):
        return
    raise HTTPException(
        415, f"the body must have the content type application/json, not {kind or 'none'} (curl: --json '{{…}}')"
    )
