"""The page in Debian's Chromium against a running service."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from page_steps import STEP_MS, Open, wait_for_state
from playwright.sync_api import Browser, Page, Playwright, sync_playwright

CHROMIUM = "/usr/bin/chromium"
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--allow-loopback-in-peer-connection",
]


@pytest.fixture(scope="module")
def chromium() -> str:
    path = CHROMIUM if Path(CHROMIUM).exists() else shutil.which("chromium")
    if path is None:
        reason = "Chromium is not installed: apt-get install chromium"
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)
    return path


@pytest.fixture(scope="module")
def playwright() -> Iterator[Playwright]:
    with sync_playwright() as running:
        yield running


@pytest.fixture(scope="module")
def browsers(chromium: str, playwright: Playwright) -> Iterator[Callable[..., Browser]]:
    """Browsers by their flags, started when first asked for."""
    started: dict[tuple[str, ...], Browser] = {}

    def get(*flags: str) -> Browser:
        if flags not in started:
            started[flags] = playwright.chromium.launch(executable_path=chromium, args=[*FLAGS, *flags])
        return started[flags]

    yield get
    for browser in started.values():
        browser.close()


@pytest.fixture
def open_page(browsers: Callable[..., Browser], server: str) -> Open:
    """`with open_page() as page:` the page when the avatar is there; an exception in a script fails the test."""

    @contextmanager
    def opened(
        *flags: str, width: int = 1280, height: int = 800, ready: bool = True, script: str = ""
    ) -> Iterator[Page]:
        context = browsers(*flags).new_context(viewport={"width": width, "height": height})
        context.set_default_timeout(STEP_MS)
        page = context.new_page()
        exceptions: list[str] = []
        page.on("pageerror", lambda error: exceptions.append(str(error)))
        if script:
            page.add_init_script(script)
        try:
            page.goto(f"{server}/")
            if ready:
                wait_for_state(page, "idle")
            yield page
        finally:
            context.close()
        assert exceptions == []

    return opened
