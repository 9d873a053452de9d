"""What every request passes: a bound on its body, safe headers, one line in the log.

Plain ASGI, because Starlette's `BaseHTTPMiddleware` hides from a response that its viewer has gone.
"""

from __future__ import annotations

import time
from typing import Any

import structlog
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.api.problems import problem, unexpected

_log = structlog.get_logger("mary.api")

FORM = "multipart/form-data"

_QUIET = {"/healthz", "/readyz", "/static"}
"""Routes that would only fill the log."""


class BodyLimit:
    """Refuse bodies that are too long before they are read, or while, when their length was not announced.

    Args:
        app: the rest of the application.
        limit: bytes of a body.
        form_limit: bytes of one that is a form, which may hold a recording.
    """

    def __init__(self, app: ASGIApp, limit: int, form_limit: int) -> None:
        self._app = app
        self._limit = limit
        self._form_limit = form_limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        limit = self._form_limit if headers.get("content-type", "").lower().startswith(FORM) else self._limit
        announced = headers.get("content-length", "")
        if announced.isdecimal() and int(announced) > limit:
            # The body is not read, so the connection cannot carry another request.
            answer = problem(
                413,
                "too-long",
                "Too long",
                _too_long(limit),
                advice="Send less at a time.",
                headers={"Connection": "close"},
            )
            await answer(scope, receive, send)
            return
        taken = 0

        async def counted() -> Message:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b""))
            if taken > limit:
                raise HTTPException(413, _too_long(limit), {"Connection": "close"})
            return message

        await self._app(scope, counted, send)


def _too_long(limit: int) -> str:
    return f"the body is longer than {limit} bytes"


class Envelope:
    """Headers that make answers safe to have in a browser, and one line in the log for each request.

    Exceptions that nobody handled are answered here: Starlette's own handler stands outside of all middleware, where
    the answer would get neither headers nor its line.

    The line names the route, never the address asked for (a stream's address is the key to it) nor what was said.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        started = time.perf_counter()
        status = 0

        async def with_headers(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                headers.setdefault("X-Content-Type-Options", "nosniff")
                headers.setdefault("Referrer-Policy", "no-referrer")
            await send(message)

        try:
            await self._app(scope, receive, with_headers)
        except Exception:
            if status == 0:
                await unexpected()(scope, receive, with_headers)
            raise  # so that the server logs it with its traceback
        finally:
            route = _route(scope)
            if route not in _QUIET:
                _log.info(
                    "request",
                    method=scope["method"],
                    route=route,
                    status=status,
                    seconds=round(time.perf_counter() - started, 3),
                )


def _route(scope: Scope) -> str:
    route: Any = scope.get("route")
    path = getattr(route, "path", None)
    if isinstance(path, str):
        return path
    return "/static" if scope["path"].startswith("/static/") else "(none)"
