"""Pages of other origins: which may use the service, and what they may see of its answers (CORS)."""

from __future__ import annotations

from collections.abc import Sequence

from starlette.datastructures import MutableHeaders
from starlette.middleware.cors import CORSMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

METHODS = ("DELETE", "GET", "HEAD", "PATCH", "POST")
SENT = ("Content-Type", "If-Match", "Last-Event-ID", "Range")
"""Headers a page may send."""
SEEN = (
    "Accept-Patch", "Accept-Ranges", "Content-Range", "ETag", "Link", "Location", "Mary-Confidence", "Mary-Guessed",
    "Mary-Unread", "Retry-After",
)  # fmt: skip
"""Headers of an answer that a page may read, beside those it always may."""
PREFLIGHT_SECONDS = 600  # how long a browser need not ask again


class CrossOrigin(CORSMiddleware):
    """Starlette's, for `origins`; outermost, so that errors too can be read.

    It answers preflights itself. Those of WHEP get the header that its draft wants on every answer to OPTIONS.
    """

    def __init__(self, app: ASGIApp, origins: Sequence[str]) -> None:
        super().__init__(
            app,
            allow_origins=origins,
            allow_methods=METHODS,
            allow_headers=SENT,
            expose_headers=SEEN,
            max_age=PREFLIGHT_SECONDS,
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_accept_post(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).setdefault("Accept-Post", "application/sdp")
            await send(message)

        whep = scope["type"] == "http" and scope["method"] == "OPTIONS" and scope["path"].endswith("/whep")
        await super().__call__(scope, receive, with_accept_post if whep else send)
