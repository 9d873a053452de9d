"""Cutting Mary short."""

from __future__ import annotations

import pytest
from page_steps import LONG, Open, choose, enter, report_on, report_path, say, streams_asked_for, wait_for_state
from playwright.sync_api import Page, Route, expect


@pytest.mark.parametrize("transport", ["webrtc", "mp4"])
def test_enter_while_speaking_says_the_new_text(open_page: Open, transport: str) -> None:
    with open_page() as page:
        choose(page, transport)
        say(page, LONG)
        first = page.locator("#picture").get_attribute("data-utterance")
        enter(page, "Something else.")
        page.wait_for_selector(f"#picture:not([data-utterance='{first}'])")
        wait_for_state(page, "idle")
        expect(page.locator("#problem")).to_be_hidden()


@pytest.mark.parametrize("transport", ["webrtc", "mp4"])
@pytest.mark.parametrize("how", ["button", "escape"])
def test_stop(open_page: Open, transport: str, how: str) -> None:
    with open_page() as page:
        asked = streams_asked_for(page)
        choose(page, transport)
        expect(page.locator("#stop")).to_be_disabled()
        say(page, LONG)
        if how == "button":
            page.click("#stop")
        else:
            page.press("#text", "Escape")
        wait_for_state(page, "idle")
        expect(page.locator("#frame")).to_have_attribute("data-shown", "idle")
        expect(page.locator("#problem")).to_be_hidden()
        while report_on(page, asked[-1])["utterances"][-1]["state"] == "speaking":
            page.wait_for_timeout(50)  # the page does not wait for the answer
        assert report_on(page, asked[-1])["utterances"][-1]["state"] == "interrupted"
        say(page, "And on.")
        wait_for_state(page, "idle")


class Held:
    """Requests that get no answer before they are let go."""

    def __init__(self, page: Page, pattern: str, method: str) -> None:
        self._page, self._method = page, method
        self._routes: list[Route] = []
        self._holding = True
        page.route(pattern, self._hold)

    def _hold(self, route: Route) -> None:
        if self._holding and route.request.method == self._method:
            self._routes.append(route)
        else:
            route.continue_()

    def wait(self) -> None:
        while not self._routes:
            self._page.wait_for_timeout(20)

    def let_go(self) -> None:
        self._holding = False
        for route in self._routes:
            route.continue_()


@pytest.mark.parametrize(
    ("transport", "pattern"),
    [("auto", "**/whep"), ("webrtc", "**/whep"), ("webrtc", "**/say"), ("mp4", "**/v1/streams")],
)
def test_stop_acts_at_once_while_the_connection_is_being_made(open_page: Open, transport: str, pattern: str) -> None:
    with open_page() as page:
        asked = streams_asked_for(page)
        choose(page, transport)
        held = Held(page, pattern, "POST")
        enter(page, LONG)
        wait_for_state(page, "preparing")
        held.wait()
        page.click("#stop")
        assert page.evaluate("document.body.dataset.state") == "idle"

        held.let_go()
        page.wait_for_timeout(1500)  # time enough to begin to speak after all
        assert page.evaluate("document.body.dataset.state") == "idle"
        assert page.locator("#frame").get_attribute("data-shown") == "idle"
        assert page.locator("#picture").get_attribute("data-utterance") is None
        expect(page.locator("#problem")).to_be_hidden()
        here = asked[-1].url.removesuffix("/v1/streams") + report_path(asked[-1])
        answer = page.request.get(here)
        states = {one["state"] for one in answer.json().get("utterances", [])}
        assert states <= {"interrupted"}

        say(page, "And on.")
        wait_for_state(page, "idle")


def test_stop_while_the_connection_fails_says_nothing(open_page: Open) -> None:
    with open_page() as page:
        choose(page, "webrtc")
        page.route("**/whep", lambda _: None)
        enter(page, LONG)
        wait_for_state(page, "preparing")
        page.click("#stop")
        page.context.set_offline(True)
        page.wait_for_timeout(500)
        expect(page.locator("#problem")).to_be_hidden()
        assert page.evaluate("document.body.dataset.state") == "idle"


def test_what_others_stop_before_its_first_sound_is_over(open_page: Open) -> None:
    with open_page() as page:
        asked = streams_asked_for(page)
        choose(page, "mp4")
        held = Held(page, "**/live.mp4", "GET")
        enter(page, LONG)
        held.wait()  # until somebody watches, nothing is said
        assert page.evaluate("document.body.dataset.state") == "preparing"
        here = asked[-1].url.removesuffix("/v1/streams") + report_path(asked[-1])
        page.request.post(f"{here}/interrupt")
        wait_for_state(page, "idle")
        expect(page.locator("#problem")).to_be_hidden()
        held.let_go()
        say(page, "And on.")
        wait_for_state(page, "idle")


@pytest.mark.parametrize("transport", ["webrtc", "mp4"])
def test_stop_does_not_reach_what_is_said_next(open_page: Open, transport: str) -> None:
    with open_page() as page:
        choose(page, transport)
        say(page, LONG)
        first = page.locator("#picture").get_attribute("data-utterance")
        page.fill("#text", LONG)
        page.evaluate("document.getElementById('stop').click(); document.getElementById('composer').requestSubmit()")
        page.wait_for_selector(f"#picture:not([data-utterance='{first}'])")
        page.wait_for_timeout(2500)
        assert page.evaluate("document.body.dataset.state") == "speaking"
        page.click("#stop")
        wait_for_state(page, "idle")
