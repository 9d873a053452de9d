"""One question to an HTTP server and its whole answer, within one limit of time.

httpx limits every single wait; a server that sends a byte now and then keeps one waiting for ever. So exchanges run on
an event loop in a thread of their own, where one limit covers everything: finding the address, connecting, headers,
body, and trying again.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import logging
import random
import threading
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from email.utils import parsedate_to_datetime
from http import HTTPStatus
from time import time
from typing import Annotated

import httpx
from pydantic import AfterValidator

from app.answer import MOST_COMPLAINT, Answer, complaint_of

MOST_CONNECTIONS = 16
BACKOFF = 0.2  # seconds before the first new trial; doubles with every further one
GRACE = 2.0  # seconds for the loop to end what is over its limit

# httpx tells every address it asks, and a sentence to speak may be in it. No text that is spoken is in the log.
logging.getLogger("httpx").setLevel(logging.WARNING)


def _url(text: str) -> str:
    try:
        url = httpx.URL(text)
    except httpx.InvalidURL as error:
        raise ValueError(f"not an address: {error}") from error
    if url.scheme not in ("http", "https") or not url.host:
        raise ValueError('not an address; they look like "http://localhost:8765/path"')
    return text


Url = Annotated[str, AfterValidator(_url)]
"""The address of a server in options."""


class ExchangeFailed(Exception):
    """There is no usable answer.

    Attributes:
        reason: in words that follow the name of whoever asked.
        advice: what to do about it.
    """

    def __init__(self, reason: str, advice: str = "") -> None:
        super().__init__(reason)
        self.reason = reason
        self.advice = advice


class Exchange:
    """Asks servers. `ask` blocks and may be called from several threads; connections are kept and shared.

    Args:
        seconds: limit for one question and its whole answer, new trials included.
        connect_seconds: limit for one trial to connect.
        retries: further trials after a failed connection or an answer 408, 429 or 5xx. A connection that breaks before
            any answer counts as failed: it may have been kept from before.
        most_bytes: longest answer that is taken.
        secrets: what is never told, though an answer says it.
    """

    def __init__(
        self,
        *,
        seconds: float,
        connect_seconds: float = 2.0,
        retries: int = 2,
        most_bytes: int,
        secrets: Sequence[str] = (),
    ) -> None:
        self._seconds = seconds
        self._connect_seconds = connect_seconds
        self._retries = retries
        self._most_bytes = most_bytes
        self._secrets = [secret for secret in secrets if secret]
        self._lock = threading.Lock()
        self._thread: _Loop | None = None

    def ask(
        self,
        method: str,
        url: str,
        *,
        params: Mapping[str, str] | None = None,
        headers: Mapping[str, str] | None = None,
        content: bytes | None = None,
        seconds: float | None = None,
    ) -> Answer:
        """Send one request and read the whole answer.

        Args:
            method: GET or POST.
            url: http or https; `params` are added to those that it has.
            params, headers, content: of the request.
            seconds: another limit for this one.

        Raises:
            ExchangeFailed: no server, no answer in time, an answer that is not 2xx, too long, or `close` was called.
        """
        limit = seconds or self._seconds
        with self._lock:
            if self._thread is None:
                self._thread = _Loop(self._connect_seconds)
                weakref.finalize(self, self._thread.end)
            thread = self._thread
        address = httpx.URL(url)
        if params:
            address = address.copy_merge_params(dict(params))
        request = thread.client.build_request(method, address, headers=headers, content=content)
        asked = self._asked(thread.client, request, limit)
        try:
            future = asyncio.run_coroutine_threadsafe(asked, thread.loop)
        except RuntimeError as error:  # the loop was closed just now
            asked.close()
            raise ExchangeFailed("it was closed") from error
        try:
            return future.result(limit + GRACE)
        except concurrent.futures.CancelledError as error:
            raise ExchangeFailed("it was closed") from error
        except TimeoutError as error:
            raise _late(limit) from error
        finally:
            future.cancel()  # after Ctrl-C, too

    def close(self) -> None:
        """End all connections; questions under way in other threads fail. The next question connects anew."""
        with self._lock:
            thread, self._thread = self._thread, None
        if thread is not None:
            thread.end()

    async def _asked(self, client: httpx.AsyncClient, request: httpx.Request, limit: float) -> Answer:
        trial = 0
        failure: _Again | None = None
        try:
            async with asyncio.timeout(limit) as deadline:
                while True:
                    try:
                        return await self._once(client, request)
                    except _Again as again:
                        failure = again
                    left = (deadline.when() or 0.0) - asyncio.get_running_loop().time()
                    pause = failure.after
                    if pause is None:
                        pause = BACKOFF * 2**trial * random.uniform(0.5, 1.0)  # not all at the same time again
                    if trial >= self._retries:
                        raise ExchangeFailed(failure.reason, failure.advice)
                    if pause >= left:
                        when = f"; it asks to come back in {pause:.0f} s" if failure.after else ""
                        raise ExchangeFailed(failure.reason + when, failure.advice)
                    await asyncio.sleep(pause)
                    trial += 1
        except TimeoutError as error:
            raise _late(limit, failure.reason if failure else "") from error

    async def _once(self, client: httpx.AsyncClient, request: httpx.Request) -> Answer:
        where = request.url.netloc.decode("ascii", "replace")
        begun = False
        try:
            answer = await client.send(request, stream=True)
            begun = True
            try:
                return await self._read(answer, where)
            finally:
                await answer.aclose()
        except httpx.ConnectTimeout as error:
            reason = f"{where} does not take a connection within {self._connect_seconds:g} s"
            raise _Again(reason, "Is the server running, and is the address right?") from error
        except httpx.ConnectError as error:
            reason = f"{where} cannot be connected to ({_plain(error)})"
            raise _Again(reason, "Is the server running, and is the address right?") from error
        except httpx.TransportError as error:
            if begun:
                raise ExchangeFailed(f"{where} broke its answer off ({_plain(error)})", "Try again.") from error
            raise _Again(f"{where} gave no answer ({_plain(error)})", "See the server's log.") from error
        except httpx.DecodingError as error:
            raise ExchangeFailed(f"{where} sent an answer that cannot be unpacked ({_plain(error)})") from error

    async def _read(self, answer: httpx.Response, where: str) -> Answer:
        status = answer.status_code
        if 300 <= status < 400:
            target = answer.headers.get("location", "")
            asked_for = answer.request.url.join(target).copy_with(query=None) if target else "nowhere"
            raise ExchangeFailed(f"{where} redirects to {asked_for}", "Redirects are not followed: set that address.")
        kind = answer.headers.get("content-type", "").lower()
        if 200 <= status < 300:
            return Answer(await self._body(answer, where), kind)
        complaint = complaint_of(Answer(await _beginning(answer), kind))
        for secret in self._secrets:
            complaint = complaint.replace(secret, "…")
        named = f"{status} {_phrase(status)}".rstrip()
        reason = f"{where} answered {named}" + (f": “{complaint}”" if complaint else "")
        if status in (HTTPStatus.REQUEST_TIMEOUT, HTTPStatus.TOO_MANY_REQUESTS) or status >= 500:
            raise _Again(reason, "See the server's log.", _retry_after(answer.headers.get("retry-after", "")))
        raise ExchangeFailed(reason, _ADVICE.get(status, ""))

    async def _body(self, answer: httpx.Response, where: str) -> bytes:
        too_long = ExchangeFailed(f"{where} sent more than {self._most_bytes:,} bytes", "Is the address right?")
        promised = answer.headers.get("content-length", "")
        if promised.isdecimal() and int(promised) > self._most_bytes:
            raise too_long
        body = bytearray()
        async for part in answer.aiter_bytes():
            body += part
            if len(body) > self._most_bytes:
                raise too_long
        return bytes(body)


_ADVICE: dict[int, str] = {
    HTTPStatus.UNAUTHORIZED: "Check the key.",
    HTTPStatus.FORBIDDEN: "Check the key.",
    HTTPStatus.NOT_FOUND: "Check the address and what is asked for.",
    HTTPStatus.METHOD_NOT_ALLOWED: "Check the address and the method.",
}


class _Again(Exception):
    """A failure after which it is worth trying again, after so many seconds if the server says when."""

    def __init__(self, reason: str, advice: str, after: float | None = None) -> None:
        super().__init__(reason)
        self.reason = reason
        self.advice = advice
        self.after = after


class _Loop:
    """An event loop in a thread, and the client whose connections live on it."""

    def __init__(self, connect_seconds: float) -> None:
        self.loop = asyncio.new_event_loop()
        self.client = httpx.AsyncClient(
            timeout=httpx.Timeout(None, connect=connect_seconds),
            limits=httpx.Limits(max_connections=MOST_CONNECTIONS, max_keepalive_connections=MOST_CONNECTIONS),
            headers={"Accept-Encoding": "identity", "User-Agent": "mary"},
        )
        self._thread = threading.Thread(target=_run, args=(self.loop, self.client), name="exchange", daemon=True)
        self._thread.start()

    def end(self) -> None:
        if not self.loop.is_closed():
            self.loop.call_soon_threadsafe(self.loop.stop)
        if threading.current_thread() is not self._thread:
            self._thread.join(GRACE)


def _run(loop: asyncio.AbstractEventLoop, client: httpx.AsyncClient) -> None:
    asyncio.set_event_loop(loop)
    try:
        loop.run_forever()
        _cancel(loop)
        loop.run_until_complete(client.aclose())
        _cancel(loop)  # what was asked just then
    finally:
        loop.close()


def _cancel(loop: asyncio.AbstractEventLoop) -> None:
    while tasks := asyncio.all_tasks(loop):
        for task in tasks:
            task.cancel()
        loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))


async def _beginning(answer: httpx.Response) -> bytes:
    body = bytearray()
    with suppress(httpx.TransportError, httpx.DecodingError):  # the status has said that it failed
        async for part in answer.aiter_bytes():
            body += part
            if len(body) >= MOST_COMPLAINT:
                break
    return bytes(body)


def _retry_after(header: str) -> float | None:
    """Seconds that a server asks one to wait, given as a number or as a date."""
    if header.strip().isdecimal():
        return float(header)
    try:
        return max(0.0, parsedate_to_datetime(header).timestamp() - time())
    except ValueError:
        return None


def _late(limit: float, before: str = "") -> ExchangeFailed:
    return ExchangeFailed(
        f"there was no whole answer within {limit:g} s" + (f" (before: {before})" if before else ""),
        "Is the server overloaded? A higher limit of seconds may help.",
    )


def _phrase(status: int) -> str:
    try:
        return HTTPStatus(status).phrase
    except ValueError:
        return ""


def _plain(error: Exception) -> str:
    return str(error) or type(error).__name__
