"""Voice and settings: offered, kept, and checked when they come back."""

from __future__ import annotations

import json

import pytest
from page_steps import Open, wait_for_state
from playwright.sync_api import Page, expect


def test_choices_are_offered_and_kept(open_page: Open) -> None:
    with open_page() as page:
        page.click("summary")
        assert page.locator("#avatar option").count() >= 1
        assert page.locator("#voice option").count() >= 2
        page.fill("#speed", "1.5")
        page.select_option("#transport", "mp4")
        page.click("#mute")
        page.reload()
        wait_for_state(page, "idle")
        assert page.locator("#speed").input_value() == "1.5"
        assert page.locator("#transport").input_value() == "mp4"
        expect(page.locator("#mute")).to_have_attribute("aria-pressed", "true")
        assert page.locator("#live").evaluate("(live) => live.muted")


@pytest.mark.parametrize(
    "stored",
    [
        "null",
        "5",
        "{",
        '["mp4"]',
        '{"speed": "x"}',
        '{"speed": null}',
        '{"speed": 99}',
        '{"volume": -1}',
        '{"volume": "loud"}',
        '{"transport": "pigeon"}',
        '{"transport": 5}',
        '{"avatar": {}}',
        '{"voice": 7}',
        '{"muted": "yes"}',
        '{"captions": 0}',
        '{"unknown": 1}',
    ],
)
def test_stored_nonsense_is_ignored(open_page: Open, stored: str) -> None:
    script = f"localStorage.setItem('mary.preferences', {json.dumps(stored)});"
    with open_page(script=script) as page:
        assert shown(page) == DEFAULTS


def test_what_is_stored_beside_nonsense_is_kept(open_page: Open) -> None:
    stored = {"speed": 3, "volume": 0.5, "transport": "mp4", "captions": False}
    script = f"localStorage.setItem('mary.preferences', {json.dumps(json.dumps(stored))});"
    with open_page(script=script) as page:
        assert shown(page) == DEFAULTS | {"volume": "0.5", "transport": "mp4", "captions": "false"}


DEFAULTS = {
    "avatar": "mary", "voice": "", "speed": "1", "transport": "auto", "volume": "1", "mute": "false", "captions": "true"
}  # fmt: skip


def shown(page: Page) -> dict[str, str]:
    """The choices as the controls show them."""
    fields = {
        name: page.locator(f"#{name}").input_value() for name in ("avatar", "voice", "speed", "transport", "volume")
    }
    switches = {name: page.locator(f"#{name}").get_attribute("aria-pressed") or "" for name in ("mute", "captions")}
    return fields | switches
