"""Where a stream can be pushed: what of a caller's URL is allowed, and what of it may be shown.

FFmpeg opens the URL, and knows far more schemes than the two kinds meant here (files, pipes, `concat:`). So a URL is
taken only if it is that of a server, by RTMP or HTTP, in the characters of RFC 3986: what follows a blank would be
options.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Literal
from urllib.parse import SplitResult, unquote, urlsplit

from app.errors import ConfigError, InputError

PushKind = Literal["rtmp", "whip"]

MAX_URL = 1_000
"""Characters; FFmpeg cuts longer RTMP addresses short."""

_KINDS: dict[str, PushKind] = {"rtmp": "rtmp", "rtmps": "rtmp", "http": "whip", "https": "whip"}
_SCHEMES: dict[PushKind, str] = {"rtmp": "rtmp:// or rtmps://", "whip": "http:// or https://"}
_ALLOWED = re.compile(r"[A-Za-z0-9\-._~:/?\[\]@!$&'()*+,;=%]+")
_TOKEN = re.compile(r"[\x21-\x7e]+")
_HIDDEN = "…"


@dataclass(frozen=True, slots=True)
class PushTarget:
    """A server to push to.

    Attributes:
        kind: by which protocol.
        url: the whole URL, with what is secret in it.
        shown: what is no key for any server: scheme and host, for RTMP the application too.
        token: bearer token of a WHIP server, or "".
    """

    kind: PushKind
    url: str = field(repr=False)
    shown: str
    token: str = field(default="", repr=False)

    def hide(self, text: str) -> str:
        """`text` without anything of the target that is not to be shown."""
        parts = urlsplit(self.url)
        path = parts.path.strip("/")
        keys = path.partition("/")[2] if self.kind == "rtmp" else path
        secrets = [self.url, self.token, parts.username, parts.password, parts.query, f"{keys}?{parts.query}", keys]
        secrets += keys.split("/")
        found = {each for secret in secrets if secret for each in (secret, unquote(secret))}
        for secret in sorted(found, key=len, reverse=True):
            text = text.replace(secret, _HIDDEN)
        return text


def push_target(
    url: str, *, kind: PushKind | None = None, token: str = "", hosts: Collection[str] = (), field: str = "url"
) -> PushTarget:
    """What `url` leads to.

    Args:
        url: as the caller gave it.
        kind: the only one allowed; None: either.
        token: bearer token for a WHIP server.
        hosts: the only ones allowed; empty: any.
        field: of the request, for the error.

    Raises:
        InputError: it is no such URL, or not allowed. The message does not hold the URL, which may hold a password.
    """

    def refused(what: str, advice: str) -> InputError:
        return InputError(f"{field} {what}", advice=advice, field=field)

    example = "rtmp://host/application/key" if kind != "whip" else "https://host/whip"
    if not url:
        raise refused("is empty", f"Write it like {example}.")
    if len(url) > MAX_URL or not _ALLOWED.fullmatch(url):
        raise refused(
            f"is not a URL of at most {MAX_URL:,} plain characters",
            f"Write it like {example}; blanks and other special characters percent-encoded.",
        )
    try:
        parts = urlsplit(url)
        scheme, host, port = parts.scheme.lower(), parts.hostname, parts.port
    except ValueError as error:
        raise refused("is not a valid URL", f"Write it like {example}.") from error
    found = _KINDS.get(scheme)
    if found is None or kind not in (None, found):
        wanted = _SCHEMES[kind] if kind else " or ".join(_SCHEMES.values())
        raise refused("has a scheme that is not allowed", f"Use {wanted}.")
    if not host or port == 0 or not url[len(scheme) :].startswith("://"):
        raise refused("names no server", f"Write it like {example}.")
    if hosts and host.lower() not in {each.lower() for each in hosts}:
        raise refused("leads to a server that is not allowed", "The operator's push.hosts names those that are.")
    if found == "rtmp" and len([part for part in parts.path.split("/") if part]) < 2:
        raise refused("has no application and key", f"Write it like {example}.")
    if token and (found != "whip" or len(token) > MAX_URL or not _TOKEN.fullmatch(token)):
        raise InputError("token is not a bearer token for a WHIP server", field="token")
    return PushTarget(found, url, _shown(parts), token)


def own_target(server: str, key: str) -> PushTarget:
    """What is called `key` on the service's own RTMP server, `push.rtmp` of the settings.

    Raises:
        ConfigError: the setting is no such server. `check_own_server` finds that out when the service starts.
    """
    base, separator, query = server.partition("?")
    try:
        return push_target(f"{base.rstrip('/')}/{key}{separator}{query}", kind="rtmp", field="push.rtmp")
    except InputError as error:
        advice = "Correct push.rtmp in the settings (MARY_PUSH__RTMP), e.g. rtmp://localhost/live."
        raise ConfigError(error.message, advice=advice, field="push.rtmp") from error


def new_key() -> str:
    """A key for the service's own server. Not a stream's id: what it tells must not be the key to the stream."""
    return secrets.token_urlsafe(16)


def check_own_server(server: str) -> None:
    """Refuse a setting that no stream could be pushed to; see `own_target`."""
    if server:
        own_target(server, new_key())


def without_credentials(url: str) -> str:
    """`url` without user, password and query: where players find what is pushed there."""
    parts = urlsplit(url)
    return f"{parts.scheme}://{_host(parts)}{parts.path}"


def _shown(parts: SplitResult) -> str:
    application = parts.path.strip("/").partition("/")[0] if parts.scheme.lower().startswith("rtmp") else ""
    return "/".join(filter(None, [f"{parts.scheme}://{_host(parts)}", application, _HIDDEN]))


def _host(parts: SplitResult) -> str:
    return parts.netloc.rpartition("@")[2]
