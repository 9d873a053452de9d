"""What the tests of the page do again and again: opening it, typing, waiting, asking the service."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, Request

SENTENCE = "Hello, I am Mary, and I say whatever you type."
LONG = "This is a rather long story that somebody will want to stop. " * 12
STEP_MS = 20_000  # a step that takes longer has failed

Open = Callable[..., AbstractContextManager[Page]]


def wait_for_state(page: Page, state: str) -> None:
    page.wait_for_selector(f"body[data-state={state}]", timeout=STEP_MS)


def choose(page: Page, transport: str) -> None:
    page.click("summary")
    page.select_option("#transport", transport)
    page.click("summary")


def enter(page: Page, text: str) -> None:
    page.click("#text")
    page.fill("#text", text)
    page.press("#text", "Enter")


def say(page: Page, text: str) -> None:
    enter(page, text)
    wait_for_state(page, "speaking")


def look(page: Page, name: str) -> None:
    folder = os.environ.get("MARY_SCREENSHOTS")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        page.screenshot(path=Path(folder) / f"{name}.png")


def streams_asked_for(page: Page) -> list[Request]:
    asked: list[Request] = []
    page.on(
        "request",
        lambda request: (
            asked.append(request) if request.method == "POST" and request.url.endswith("/streams") else None
        ),
    )
    return asked


def report_on(page: Page, request: Request) -> Any:
    stream = request.response().json()  # type: ignore[union-attr]
    return page.request.get(request.url.removesuffix("/v1/streams") + stream["urls"]["self"]).json()


def report_path(request: Request) -> str:
    path: str = request.response().json()["urls"]["self"]  # type: ignore[union-attr]
    return path
