"""How the page looks, is reached by keys, and that it needs nothing from elsewhere."""

from __future__ import annotations

import re
import statistics
from itertools import pairwise

import pytest
from page_steps import Open, look, say, wait_for_state


def test_the_idle_clip_goes_on_without_a_seam(open_page: Open) -> None:
    with open_page() as page:
        frames = page.evaluate(
            """() => new Promise((resolve) => {
              const idle = document.getElementById('picture').shadowRoot.getElementById('idle'), frames = [];
              const onFrame = (now, {mediaTime}) => {
                frames.push(mediaTime);
                if (mediaTime > 11) resolve({frames, loop: idle.loop});
                else idle.requestVideoFrameCallback(onFrame);
              };
              idle.requestVideoFrameCallback(onFrame);
            })"""
        )
    assert frames["loop"] is False
    steps = [b - a for a, b in pairwise(frames["frames"])]
    assert min(steps) > 0
    assert statistics.median(steps) == pytest.approx(0.04, abs=0.001)


def test_keyboard_alone_is_enough(open_page: Open) -> None:
    with open_page() as page:
        page.focus("#text")
        page.keyboard.type("First line")
        page.keyboard.press("Shift+Enter")
        page.keyboard.type("second line")
        assert page.locator("#text").input_value() == "First line\nsecond line"
        reached = []
        for _ in range(12):
            page.keyboard.press("Tab")
            reached.append(page.evaluate("document.activeElement.id || document.activeElement.localName"))
        assert reached[0] == "speak"
        for name in ("mute", "volume", "captions", "summary"):
            assert name in reached
        page.focus("#speak")
        page.keyboard.press("Enter")
        wait_for_state(page, "speaking")
        page.keyboard.press("Escape")
        wait_for_state(page, "idle")
        for field in page.locator("button, select, input, textarea, a").all():
            assert field.evaluate("(e) => Boolean(e.labels?.length || e.ariaLabel || e.textContent.trim())")


@pytest.mark.parametrize(("width", "height"), [(320, 640), (390, 844), (844, 390), (768, 1024), (1280, 800)])
def test_it_fits_the_screen(open_page: Open, width: int, height: int) -> None:
    with open_page(width=width, height=height) as page:
        page.click("summary")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        before = page.locator("#picture").bounding_box()
        page.click("summary")
        say(page, "Nothing moves but me.")
        assert page.locator("#picture").bounding_box() == before
        look(page, f"speaking-{width}x{height}")
        wait_for_state(page, "idle")


def test_nothing_is_fetched_from_elsewhere(open_page: Open, server: str) -> None:
    elsewhere: list[str] = []
    with open_page(ready=False) as page:
        page.on(
            "request",
            lambda request: (
                elsewhere.append(request.url)
                if not re.match(rf"{re.escape(server)}/|blob:|data:", request.url)
                else None
            ),
        )
        page.reload()
        wait_for_state(page, "idle")
        say(page, "Hello.")
        wait_for_state(page, "idle")
        assert page.evaluate("document.querySelectorAll('style, [style], script:not([src])').length") == 0
    assert elsewhere == []
