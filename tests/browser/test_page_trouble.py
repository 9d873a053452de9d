"""What the page says and does when something is not as it should be."""

from __future__ import annotations

import urllib.request
from collections.abc import Callable

import pytest
from page_steps import SENTENCE, Open, choose, enter, report_path, say, streams_asked_for, wait_for_state
from playwright.sync_api import Route, expect


@pytest.mark.parametrize("transport", ["auto", "mp4"])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("   ", "Type something"),
        ("🙂🙂", "."),  # the service's own words
        ("word " * 4000, "."),
    ],
    ids=["blank", "unreadable", "too-long"],
)
def test_errors_are_shown_and_pass(open_page: Open, transport: str, text: str, message: str) -> None:
    with open_page() as page:
        choose(page, transport)
        enter(page, text)
        expect(page.locator("#problem")).to_be_visible()
        expect(page.locator("#problem")).to_contain_text(message)
        wait_for_state(page, "idle")
        say(page, "Fine.")
        expect(page.locator("#problem")).to_be_hidden()
        wait_for_state(page, "idle")


def test_a_stream_that_has_ended_is_replaced(open_page: Open, server: str) -> None:
    with open_page() as page:
        asked = streams_asked_for(page)
        say(page, "Before.")
        wait_for_state(page, "idle")
        end = urllib.request.Request(server + report_path(asked[0]), method="DELETE")
        urllib.request.urlopen(end).close()
        say(page, "After.")
        wait_for_state(page, "idle")
        assert len(asked) == 2
        expect(page.locator("#problem")).to_be_hidden()


def test_a_stream_that_ends_at_the_last_moment_is_replaced(open_page: Open) -> None:
    refused: list[str] = []

    def refuse_once(route: Route) -> None:
        if refused:
            route.continue_()
            return
        refused.append(route.request.url)
        route.fulfill(
            status=410, content_type="application/problem+json", body='{"status": 410, "detail": "It ended."}'
        )

    with open_page() as page:
        asked = streams_asked_for(page)
        page.route("**/say", refuse_once)
        say(page, "Still here.")
        wait_for_state(page, "idle")
        assert len(refused) == 1
        assert len(asked) == 2
        expect(page.locator("#problem")).to_be_hidden()


def refuse_offer(route: Route) -> None:
    body = '{"status": 400, "title": "WebRTC negotiation failed", "detail": "The offer cannot be answered."}'
    route.fulfill(status=400, content_type="application/problem+json", body=body)


def hide_addresses(route: Route) -> None:
    """An answer as from a server behind a firewall: nothing can be reached."""
    answer = route.fetch()
    lines = [line for line in answer.text().splitlines() if "candidate" not in line]
    route.fulfill(response=answer, body="\r\n".join(lines) + "\r\n")


@pytest.mark.parametrize("obstacle", [refuse_offer, hide_addresses])
def test_without_webrtc_it_falls_back_to_mp4(open_page: Open, obstacle: Callable[[Route], None]) -> None:
    with open_page() as page:
        page.route("**/whep", obstacle)
        say(page, SENTENCE)
        expect(page.locator("#notice")).to_contain_text("HTTP")
        assert page.locator("#picture").get_attribute("data-transport") == "mp4"
        wait_for_state(page, "idle")


def test_webrtc_alone_says_what_is_wrong(open_page: Open) -> None:
    with open_page() as page:
        page.route("**/whep", refuse_offer)
        choose(page, "webrtc")
        enter(page, SENTENCE)
        expect(page.locator("#problem")).to_contain_text("The offer cannot be answered.")
        wait_for_state(page, "idle")


def test_without_network_it_says_so(open_page: Open) -> None:
    with open_page() as page:
        page.context.set_offline(True)
        enter(page, SENTENCE)
        expect(page.locator("#problem")).to_contain_text("offline")
        wait_for_state(page, "idle")
        page.context.set_offline(False)
        say(page, "Back again.")
        wait_for_state(page, "idle")


def test_a_service_that_is_away_is_tried_again(open_page: Open) -> None:
    with open_page(ready=False) as page:
        page.route("**/v1/avatars", lambda route: route.abort())
        page.reload()
        expect(page.locator("#problem")).to_contain_text("cannot be reached")
        page.unroute("**/v1/avatars")
        wait_for_state(page, "idle")
        expect(page.locator("#problem")).to_be_hidden()
