"""<mary-avatar> on a page of its own: what it does for whoever embeds it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pytest
from page_steps import LONG, STEP_MS
from playwright.sync_api import Browser, Page, expect

OPENINGS = """
  window.open_ones = {peers: new Set(), sources: new Set()};
  for (const [kind, name] of [["peers", "RTCPeerConnection"], ["sources", "EventSource"]]) {
    const Class = window[name];
    window[name] = class extends Class {
      constructor(...options) { super(...options); window.open_ones[kind].add(this); }
      close() { super.close(); window.open_ones[kind].delete(this); }
    };
  }
"""
NOTES = """
  window.notes = [];
  for (const name of ["state", "accepted", "shown", "speak_started", "word", "viseme", "speak_ended", "problem"])
    document.addEventListener(name, ({target, detail}) => notes.push({name, from: target.id, detail}));
"""

Embed = Callable[..., AbstractContextManager[Page]]


@pytest.fixture
def embed(browsers: Callable[..., Browser], server: str) -> Embed:
    """`with embed("<mary-avatar …>") as page:` a page that holds the component; scripts must not fail."""

    @contextmanager
    def opened(body: str, *, first: str = "") -> Iterator[Page]:
        context = browsers("--autoplay-policy=no-user-gesture-required").new_context(
            viewport={"width": 480, "height": 480}
        )
        context.set_default_timeout(STEP_MS)
        page = context.new_page()
        exceptions: list[str] = []
        page.on("pageerror", lambda error: exceptions.append(str(error)))
        page.add_init_script(OPENINGS + NOTES)
        html = f"<!doctype html>{first}<body>{body}<script type=module src=/mary.js></script>"
        page.route("**/host", lambda route: route.fulfill(body=html, content_type="text/html"))
        try:
            page.goto(f"{server}/host")
            yield page
        finally:
            context.close()
        assert exceptions == []

    return opened


def avatar(page: Page, script: str, **arguments: Any) -> Any:
    """`script` in the browser, with the element as `a`."""
    return page.locator("mary-avatar").evaluate(f"(a, {{{', '.join(arguments)}}}) => {script}", arguments)


def wait_for(page: Page, condition: str) -> None:
    page.wait_for_function(f"() => {{ const a = document.querySelector('mary-avatar'); return {condition}; }}")


def notes(page: Page, *names: str) -> list[dict[str, Any]]:
    return [note for note in page.evaluate("notes") if note["name"] in names]


def make_stream(page: Page, server: str, idle: str) -> str:
    answer = page.request.post(f"{server}/v1/streams", data={"idle": idle})
    return f"{server}{answer.json()['urls']['self']}"


def join(page: Page, stream: str, transport: str) -> None:
    avatar(page, "Object.assign(a, {transport, stream})", transport=transport, stream=stream)
    wait_for(page, "a.state === 'idle'")


@pytest.mark.parametrize("transport", ["webrtc", "mp4"])
def test_what_others_say_on_a_stream_is_shown(embed: Embed, server: str, transport: str) -> None:
    with embed("<mary-avatar></mary-avatar>") as page:
        stream = make_stream(page, server, "local")
        join(page, stream.rpartition("/")[2], transport)
        said = []
        for text in ("This is asked for by somebody else.", "And this, too."):  # the second one waits for the first
            said.append(page.request.post(f"{stream}/say", data={"text": text}).json()["utterance"]["id"])
        wait_for(page, "a.state === 'speaking'")
        assert avatar(page, "a.live")
        wait_for(page, "notes.filter(({name}) => name === 'speak_ended').length === 2")
        wait_for(page, "a.state === 'idle' && !a.live")
        told = [(note["name"], note["detail"]["utterance"]) for note in notes(page, "speak_started", "speak_ended")]
        assert told == [(name, one) for one in said for name in ("speak_started", "speak_ended")]
        words = [note["detail"]["text"] for note in notes(page, "word")]
        assert " ".join(words) == "This is asked for by somebody else. And this, too."
        assert notes(page, "problem") == []

        # It can speak there as well, and fall silent.
        avatar(page, "void a.say(text)", text=LONG)
        wait_for(page, "a.state === 'speaking'")
        avatar(page, "a.stop()")
        wait_for(page, "a.state === 'idle' && !a.live")
        assert notes(page, "speak_ended")[-1]["detail"]["reason"] == "interrupted"

        # The stream is not the element's to end; when somebody ends it, that is told.
        avatar(page, "a.close()")
        assert page.request.get(stream).json()["state"] == "idle"


@pytest.mark.parametrize("transport", ["webrtc", "mp4"])
def test_a_stream_with_its_own_idle_picture_stays_on(embed: Embed, server: str, transport: str) -> None:
    with embed("<mary-avatar></mary-avatar>") as page:
        stream = make_stream(page, server, "stream")
        join(page, stream, transport)
        wait_for(page, "a.live")
        for text in ("One.", "Two."):
            page.request.post(f"{stream}/say", data={"text": text})
            wait_for(page, "a.state === 'speaking'")
            wait_for(page, "a.state === 'idle'")
            assert avatar(page, "a.live")
        assert [note["detail"]["text"] for note in notes(page, "word")] == ["One.", "Two."]
        page.request.delete(stream)
        wait_for(page, "a.state === 'ended'")
        expect(page.locator("#message")).to_have_text("The stream has ended.")
        assert not avatar(page, "a.live")
        wait_for(page, "open_ones.sources.size === 0 && open_ones.peers.size === 0")


def test_what_is_said_queues_unless_it_interrupts(embed: Embed) -> None:
    with embed("<mary-avatar id=me captions=off badge=off></mary-avatar>") as page:
        wait_for(page, "a.state === 'idle'")
        answers = avatar(page, "Promise.all([a.say('First.'), a.say('Second.'), a.say('🙂')])")
        assert [bool(answer) for answer in answers] == [True, True, False]
        wait_for(page, "notes.some(({name}) => name === 'problem')")
        told = [note["name"] for note in notes(page, "speak_started", "speak_ended", "problem")]
        assert told == ["speak_started", "speak_ended"] * 2 + ["problem"]
        assert {note["from"] for note in page.evaluate("notes")} == {"me"}
        expect(page.locator("#message")).to_be_visible()
        expect(page.locator("#badge")).to_be_hidden()

        avatar(page, "void a.say(text)", text=LONG)
        wait_for(page, "a.state === 'speaking'")
        expect(page.locator("#message")).to_be_hidden()
        expect(page.locator("#caption")).to_be_hidden()
        avatar(
            page,
            "{ a.say('Never.').then((said) => notes.push({name: 'never', said})); a.say('Now.', {interrupt: true}); }",
        )
        wait_for(page, "notes.some(({name, detail}) => name === 'word' && detail.text === 'Now.')")
        assert notes(page, "never") == [{"name": "never", "said": None}]
        wait_for(page, "a.state === 'idle'")


def test_nothing_is_left_when_it_goes(embed: Embed, server: str) -> None:
    made: list[str] = []
    with embed("<div></div><mary-avatar></mary-avatar>") as page:
        page.on(
            "response",
            lambda answer: (
                made.append(answer.headers["location"])
                if answer.request.method == "POST" and answer.url.endswith("/v1/streams")
                else None
            ),
        )
        wait_for(page, "a.state === 'idle'")
        avatar(page, "void a.say(text)", text=LONG)
        wait_for(page, "a.state === 'speaking'")
        page.evaluate("document.querySelector('div').append(document.querySelector('mary-avatar'))")  # only moved
        page.wait_for_timeout(500)
        assert avatar(page, "a.state") == "speaking"
        assert page.evaluate("[open_ones.peers.size, open_ones.sources.size]") == [1, 1]
        page.evaluate("window.kept = document.querySelector('mary-avatar'); kept.remove()")
        page.wait_for_function("() => open_ones.peers.size === 0 && open_ones.sources.size === 0")
        assert page.evaluate("kept.shadowRoot.childElementCount") == 0
        while page.request.get(server + made[0]).json().get("state") not in ("ended", None):
            page.wait_for_timeout(50)

        page.evaluate("document.body.append(kept)")
        wait_for(page, "a.state === 'idle'")
        avatar(page, "void a.say('Here again.')")
        wait_for(page, "a.state === 'speaking'")
        wait_for(page, "a.state === 'idle'")


def test_what_was_set_before_it_was_defined_counts(embed: Embed) -> None:
    first = """<script>
      const early = document.createElement('mary-avatar');
      Object.assign(early, {volume: 0.25, muted: true, badge: 'Made by a computer', captions: false, transport: 'mp4'});
      addEventListener('DOMContentLoaded', () => document.body.append(early));
    </script>"""
    with embed("", first=first) as page:
        wait_for(page, "a.state === 'idle'")
        shown = avatar(page, "[a.volume, a.muted, a.getAttribute('captions'), a.transport]")
        assert shown == [0.25, True, "off", "mp4"]
        expect(page.locator("#badge")).to_have_text("Made by a computer")
        assert page.locator("#live").evaluate("(live) => [live.volume, live.muted]") == [0.25, True]
        # It has the shape of the avatar's picture and the width it is given; screen readers hear who it is.
        page.add_style_tag(content="mary-avatar { width: 300px }")
        assert avatar(page, "[a.clientWidth, a.clientHeight]") == [300, 300]
        expect(page.get_by_role("img", name="Mary, a talking head")).to_be_visible()


def test_problems_are_shown_unless_the_page_shows_them(embed: Embed) -> None:
    with embed("<mary-avatar avatar=nobody></mary-avatar>") as page:
        expect(page.locator("#message")).to_contain_text("nobody")
        page.evaluate("document.addEventListener('problem', (event) => event.preventDefault())")
        avatar(page, "a.removeAttribute('avatar')")
        wait_for(page, "a.state === 'idle'")
        expect(page.locator("#message")).to_be_hidden()
        assert avatar(page, "a.say('🙂')") is None
        expect(page.locator("#message")).to_be_hidden()
        assert notes(page, "problem")[-1]["detail"]["text"]
