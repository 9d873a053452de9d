"""CORS on a small application; `tests/browser/test_other_origin.py` has a page of another origin play a stream."""

from __future__ import annotations

from collections.abc import AsyncIterator

import httpx
import pytest
from fastapi import FastAPI
from fastapi.responses import Response

from app.api import problems
from app.api.cross_origin import CrossOrigin
from app.api.middleware import BodyLimit, Envelope
from app.errors import NotFound

FRIEND = "https://www.example.org"
STRANGER = "https://elsewhere.example"


def client_of(*origins: str) -> httpx.AsyncClient:
    app = FastAPI()
    app.add_middleware(BodyLimit, limit=100, form_limit=100)
    app.add_middleware(Envelope)
    app.add_middleware(CrossOrigin, origins=origins)
    problems.install(app)

    @app.post("/v1/streams/x/whep")
    async def whep() -> Response:
        return Response("answer", 201, {"Location": "/here", "ETag": '"x"'})

    @app.get("/none")
    async def none() -> None:
        raise NotFound("there is none")

    @app.get("/broken")
    async def broken() -> None:
        raise RuntimeError

    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url="http://test")


@pytest.fixture
async def client() -> AsyncIterator[httpx.AsyncClient]:
    async with client_of(FRIEND) as client:
        yield client


def preflight(origin: str, method: str, *headers: str) -> dict[str, str]:
    asked = {"Access-Control-Request-Headers": ", ".join(headers)} if headers else {}
    return {"Origin": origin, "Access-Control-Request-Method": method} | asked


@pytest.mark.parametrize(
    ("method", "headers"), [("POST", ["content-type"]), ("PATCH", ["content-type", "if-match"]), ("DELETE", [])]
)
async def test_a_known_origin_may(client: httpx.AsyncClient, method: str, headers: list[str]) -> None:
    answer = await client.options("/v1/streams/x/whep", headers=preflight(FRIEND, method, *headers))
    assert answer.status_code == 200
    assert answer.headers["access-control-allow-origin"] == FRIEND
    assert method in answer.headers["access-control-allow-methods"]
    assert set(headers) <= set(answer.headers.get("access-control-allow-headers", "").lower().split(", "))
    assert answer.headers["accept-post"] == "application/sdp"
    assert "Origin" in answer.headers["vary"]
    assert "access-control-allow-credentials" not in answer.headers


async def test_it_sees_the_headers_that_whep_needs(client: httpx.AsyncClient) -> None:
    answer = await client.post("/v1/streams/x/whep", headers={"Origin": FRIEND})
    assert answer.status_code == 201
    assert answer.headers["access-control-allow-origin"] == FRIEND
    seen = set(answer.headers["access-control-expose-headers"].split(", "))
    assert {"Location", "Link", "ETag", "Accept-Patch", "Retry-After"} <= seen


@pytest.mark.parametrize(
    ("method", "path", "status"), [("GET", "/none", 404), ("GET", "/broken", 500), ("PUT", "/none", 405)]
)
async def test_it_can_read_problems(client: httpx.AsyncClient, method: str, path: str, status: int) -> None:
    answer = await client.request(method, path, headers={"Origin": FRIEND})
    assert answer.status_code == status
    assert answer.headers["content-type"] == problems.MEDIA_TYPE
    assert answer.headers["access-control-allow-origin"] == FRIEND


async def test_also_one_about_a_body_that_was_not_read(client: httpx.AsyncClient) -> None:
    answer = await client.post("/v1/streams/x/whep", headers={"Origin": FRIEND}, content=b"x" * 101)
    assert answer.status_code == 413
    assert answer.headers["access-control-allow-origin"] == FRIEND


async def test_an_unknown_origin_may_not(client: httpx.AsyncClient) -> None:
    asked = await client.options("/v1/streams/x/whep", headers=preflight(STRANGER, "POST", "content-type"))
    got = await client.get("/none", headers={"Origin": STRANGER})
    assert asked.status_code == 400
    for answer in (asked, got):
        assert "access-control-allow-origin" not in answer.headers
        assert "Origin" in answer.headers["vary"]  # a cache must not hand a friend's answer on


async def test_all_origins_may_if_that_is_said() -> None:
    async with client_of("*") as client:
        for origin in (FRIEND, STRANGER):
            answer = await client.get("/none", headers={"Origin": origin})
            assert answer.headers["access-control-allow-origin"] == "*"
