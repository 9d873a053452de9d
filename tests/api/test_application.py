"""The application under any ASGI server, without `mary serve` around it."""

from __future__ import annotations

from pathlib import Path

import httpx

from app.api.application import create_app
from app.config import Settings

ROOT = Path(__file__).resolve().parents[2]


async def test_it_loads_with_its_lifespan_and_answers() -> None:
    settings = Settings.model_validate({"avatars": {"folder": ROOT / "avatars"}, "speech": {"engine": "mock"}})
    app = create_app(settings)
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://test") as client,
    ):
        assert (await client.get("/v1/voices")).status_code == 200
        made = (await client.post("/v1/streams", json={})).json()
        assert (await client.get(made["urls"]["self"])).json()["state"] == "idle"
    assert not app.state.service.ready


def test_every_address_of_the_interface_is_documented() -> None:
    paths = create_app(Settings()).openapi()["paths"]
    described = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    for path in paths:
        tail = next(part for part in reversed(path.split("/")) if part and not part.startswith("{"))
        assert tail in described, path
