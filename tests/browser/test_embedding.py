"""The recipe of docs/embedding.md, on a page of another origin."""

from __future__ import annotations

import functools
import json
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from page_steps import STEP_MS, look, streams_asked_for
from playwright.sync_api import Browser, expect

RECIPE = Path(__file__).parents[2] / "docs" / "embedding.md"


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        """Tests print nothing."""


@contextmanager
def site(folder: Path) -> Iterator[str]:
    """A web site of another origin."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


@pytest.mark.parametrize("transport", ["webrtc", "mp4"])
def test_the_recipe_works_on_another_site(
    browsers: Callable[..., Browser], own_server: Callable[..., Any], tmp_path: Path, transport: str
) -> None:
    folder = tmp_path / "site"
    folder.mkdir()
    with site(folder) as elsewhere, own_server(SERVER__CORS_ORIGINS=json.dumps([elsewhere])) as server:
        (recipe,) = re.findall(r"```html\n(<!doctype html>.*?)```", RECIPE.read_text(encoding="utf-8"), re.DOTALL)
        html = recipe.replace("https://mary.example", server.url)
        html = html.replace('<mary-avatar id="mary">', f'<mary-avatar id="mary" transport="{transport}">')
        (folder / "index.html").write_text(html, encoding="utf-8")

        context = browsers().new_context(viewport={"width": 640, "height": 520})
        context.set_default_timeout(STEP_MS)
        page = context.new_page()
        told: list[str] = []
        failed: list[str] = []
        page.on("console", lambda message: (failed if message.type == "error" else told).append(message.text))
        page.on("pageerror", lambda error: failed.append(str(error)))
        asked = streams_asked_for(page)
        page.route("**/favicon.ico", lambda route: route.fulfill(status=204))
        page.goto(elsewhere)
        page.wait_for_function("() => mary.state === 'idle'")
        page.click("#greet")
        page.wait_for_function("() => mary.state === 'speaking'")
        expect(page.locator("#caption")).to_contain_text("Good")
        look(page, f"embedded-{transport}")
        page.wait_for_function("() => mary.state === 'idle'")
        assert " ".join(told) == "Good morning. Who would you like to see?"

        page.evaluate("mary.remove()")
        stream = asked[0].response().json()["urls"]["self"]  # type: ignore[union-attr]
        while page.request.get(server.url + stream).json().get("state") not in ("ended", None):
            page.wait_for_timeout(50)
        context.close()
        assert failed == []
