"""The bound on bodies also holds for those that do not announce their length."""

from __future__ import annotations

from collections.abc import AsyncIterator

import httpx
import pytest
from fastapi import FastAPI, Request
from structlog.testing import capture_logs

from app.api import problems
from app.api.middleware import BodyLimit, Envelope

LIMIT = 100


@pytest.fixture
async def client() -> AsyncIterator[httpx.AsyncClient]:
    app = FastAPI()
    app.add_middleware(BodyLimit, limit=LIMIT, form_limit=3 * LIMIT)
    app.add_middleware(Envelope)
    problems.install(app)

    @app.post("/length")
    async def length(request: Request) -> int:
        return len(await request.body())

    @app.post("/broken")
    async def broken() -> None:
        raise RuntimeError("the secret inside")

    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://test") as client:
        yield client


async def in_pieces(size: int) -> AsyncIterator[bytes]:
    for _ in range(size // 10):
        yield b"x" * 10


async def test_bodies_up_to_the_limit_pass(client: httpx.AsyncClient) -> None:
    assert (await client.post("/length", content=b"x" * LIMIT)).json() == LIMIT
    assert (await client.post("/length", content=in_pieces(LIMIT))).json() == LIMIT


@pytest.mark.parametrize("announced", [True, False])
async def test_longer_ones_are_refused(client: httpx.AsyncClient, announced: bool) -> None:
    answer = await client.post("/length", content=b"x" * (LIMIT + 10) if announced else in_pieces(LIMIT + 10))
    assert answer.status_code == 413
    assert answer.headers["content-type"] == problems.MEDIA_TYPE
    assert answer.headers["connection"] == "close"
    assert answer.json()["type"] == "/problems/too-long"


@pytest.mark.parametrize("announced", [True, False])
async def test_a_form_may_be_longer(client: httpx.AsyncClient, announced: bool) -> None:
    form = {"Content-Type": "multipart/form-data; boundary=x"}
    for size, status in ((2 * LIMIT, 200), (3 * LIMIT + 10, 413)):
        content = b"x" * size if announced else in_pieces(size)
        assert (await client.post("/length", content=content, headers=form)).status_code == status


async def test_answers_are_safe_in_a_browser(client: httpx.AsyncClient) -> None:
    answer = await client.post("/length", content=b"")
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"


async def test_what_failed_inside_stays_inside(client: httpx.AsyncClient) -> None:
    answer = await client.post("/broken")
    assert answer.status_code == 500
    assert answer.json()["type"] == "/problems/internal"
    assert "secret" not in answer.text


async def test_what_failed_inside_has_the_envelope_too(client: httpx.AsyncClient) -> None:
    with capture_logs() as lines:
        answer = await client.post("/broken")
    assert answer.headers["content-type"] == problems.MEDIA_TYPE
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert [(line["route"], line["status"]) for line in lines] == [("/broken", 500)]


async def test_the_server_still_sees_what_failed() -> None:
    app = FastAPI()
    app.add_middleware(Envelope)
    problems.install(app)

    @app.get("/broken")
    async def broken() -> None:
        raise RuntimeError("the secret inside")

    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://test") as client:
        with pytest.raises(RuntimeError, match="secret"):
            await client.get("/broken")
