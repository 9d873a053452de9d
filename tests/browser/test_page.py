"""The page in Debian's Chromium against a running service: typing a sentence, seeing and hearing Mary say it."""

from __future__ import annotations

import os
import re
import shutil
import statistics
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, Playwright, Request, Route, expect, sync_playwright

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
NO_GESTURE_NEEDED = "--autoplay-policy=no-user-gesture-required"

SENTENCE = "Hello, I am Mary, and I say whatever you type."
LONG = "This is a rather long story that somebody will want to stop. " * 12
STEP_MS = 20_000  # a step that takes longer has failed
SETTLED_FRAMES = 40  # looks at the live picture after which the covered idle clip is in step with it

# Looks at both videos on every refresh of the display. Where things are, in pixels of the 512x512 picture: the lips
# with some skin around them, and skin that moves with the head only (forehead).
PROBE = """() => {
  const MOUTH = [208, 296, 104, 64], SKIN = [216, 120, 80, 48];
  const canvas = () => {
    const context = Object.assign(document.createElement('canvas'), {width: 52, height: 56})
      .getContext('2d', {willReadFrequently: true});
    return context;
  };
  const contexts = {idle: canvas(), live: canvas()};
  const look = (video) => {
    const context = contexts[video.id];
    if (video.readyState < 2) return null;
    context.drawImage(video, ...MOUTH, 0, 0, 52, 32);
    context.drawImage(video, ...SKIN, 0, 32, 40, 24);
    const {data: mouth} = context.getImageData(0, 0, 52, 32), {data: skin} = context.getImageData(0, 32, 40, 24);
    const mean = [0, 0, 0];
    for (let i = 0; i < skin.length; i += 4) for (let c = 0; c < 3; c += 1) mean[c] += skin[i + c] / (skin.length / 4);
    return {mouth, mean};
  };
  const change = (a, b) => {
    let sum = 0;
    for (let i = 0; i < a.length; i += 4) sum += Math.abs(a[i + 1] - b[i + 1]);
    return sum / (a.length / 4);
  };
  const looks = [];
  let stopped = false, audio = null, samples = null, last = null, lastTime = -1;
  const live = document.getElementById('live'), idle = document.getElementById('idle');
  const listen = () => {
    const stream = live.srcObject ?? live.captureStream();
    if (!stream.getAudioTracks().length) return;
    audio ??= new AudioContext();
    const analyser = audio.createAnalyser();
    audio.createMediaStreamSource(stream).connect(analyser);
    samples = {analyser, buffer: new Float32Array(analyser.fftSize), stream};
  };
  const loudness = () => {
    if (!samples) return 0;
    samples.analyser.getFloatTimeDomainData(samples.buffer);
    return Math.sqrt(samples.buffer.reduce((sum, x) => sum + x * x, 0) / samples.buffer.length);
  };
  const tick = () => {
    if (stopped) return;
    requestAnimationFrame(tick);
    const shown = document.getElementById('picture').dataset.shown;
    if (!samples && shown === 'live') listen();
    const seen = {idle: look(idle), live: look(live)}, visible = seen[shown];
    const video = shown === 'live' ? live : idle;
    looks.push({
      shown,
      state: document.body.dataset.state,
      skin: visible?.mean ?? null,
      // between two different frames of what is visible, whichever video that is
      change: last && visible && video.currentTime !== lastTime ? change(visible.mouth, last.mouth) : null,
      apart: seen.idle && seen.live ? change(seen.idle.mouth, seen.live.mouth) : null,
      skinApart: seen.idle && seen.live ? seen.idle.mean.map((x, c) => seen.live.mean[c] - x) : null,
      loudness: loudness(),
      audible: !live.muted && live.volume > 0 && !live.paused,
    });
    if (visible && video.currentTime !== lastTime) { last = visible; lastTime = video.currentTime; }
  };
  tick();
  window.probe = {looks, stop: () => { stopped = true; audio?.close(); return looks; }};
}"""

Open = Callable[..., AbstractContextManager[Page]]


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


@pytest.mark.parametrize("flags", [(), (NO_GESTURE_NEEDED,)], ids=["autoplay-guarded", "autoplay-free"])
@pytest.mark.parametrize("transport", ["webrtc", "mp4"])
def test_mary_is_seen_and_heard(open_page: Open, transport: str, flags: tuple[str, ...]) -> None:
    with open_page(*flags) as page:
        asked = streams_asked_for(page)
        choose(page, transport)
        page.evaluate(PROBE)
        page.wait_for_timeout(1500)
        look(page, "idle")
        say(page, SENTENCE)
        page.wait_for_timeout(1000)
        look(page, f"speaking-{transport}")
        wait_for_state(page, "idle")
        page.wait_for_timeout(1000)
        looks = page.evaluate("probe.stop()")
        expect(page.locator("#problem")).to_be_hidden()
        expect(page.locator("#unblock")).to_be_hidden()
        assert page.locator("#picture").get_attribute("data-transport") == transport
        timings = report_on(page, asked[-1])["utterances"][-1]["timings"]

    seen = [one for one in looks if one["skin"]]
    speaking = [one for one in seen if one["shown"] == "live"]
    silent = [one for one in seen if one["shown"] == "idle"]
    assert len(speaking) > SETTLED_FRAMES
    assert {one["state"] for one in speaking} == {"speaking"}

    # The lips move while she speaks, and nothing but the head's slow sway moves them while she does not.
    moving = [one["change"] for one in speaking if one["change"] is not None]
    still = [one["change"] for one in silent if one["change"] is not None]
    assert statistics.mean(moving) > 3 * statistics.mean(still)
    assert max(one["apart"] for one in speaking if one["apart"] is not None) > 4

    # She is heard, and only while she speaks.
    assert all(one["audible"] for one in speaking[5:-5])
    assert max(one["loudness"] for one in speaking) > 0.02
    assert looks[-1]["loudness"] < 0.002

    # Neither way does the picture flash: skin keeps its brightness from look to look.
    brightness = [sum(one["skin"]) / 3 for one in seen]
    assert max(abs(a - b) for a, b in pairwise(brightness)) < 3

    # The live picture has the colours of the idle clip: at the same phase, skin differs by at most two levels.
    settled = [one["skinApart"] for one in speaking[SETTLED_FRAMES:] if one["skinApart"]]
    for channel in range(3):
        assert abs(statistics.median(difference[channel] for difference in settled)) <= 2

    assert timings["shown"] > 0


def test_several_utterances_share_one_stream(open_page: Open) -> None:
    with open_page() as page:
        asked = streams_asked_for(page)
        for text in ("One.", "Two.", "Three."):
            say(page, text)
            wait_for_state(page, "idle")
        assert page.locator("#picture").get_attribute("data-transport") == "webrtc"
        assert len(asked) == 1
        assert len(report_on(page, asked[0])["utterances"]) == 3
        # Both loops were in step when the picture changed.
        assert abs(float(page.locator("#picture").get_attribute("data-seam") or "nan")) < 3


def test_over_mp4_every_utterance_is_a_stream(open_page: Open) -> None:
    with open_page() as page:
        asked = streams_asked_for(page)
        choose(page, "mp4")
        for text in ("One.", "Two.", "Three.", "Four.", "Five.", "Six."):
            say(page, text)
            wait_for_state(page, "idle")
            expect(page.locator("#problem")).to_be_hidden()
        assert len(asked) == 6


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
        expect(page.locator("#picture")).to_have_attribute("data-shown", "idle")
        expect(page.locator("#problem")).to_be_hidden()
        while report_on(page, asked[-1])["utterances"][-1]["state"] == "speaking":
            page.wait_for_timeout(50)  # the page does not wait for the answer
        assert report_on(page, asked[-1])["utterances"][-1]["state"] == "interrupted"
        say(page, "And on.")
        wait_for_state(page, "idle")


def test_replay_and_download(open_page: Open) -> None:
    with open_page() as page:
        expect(page.locator("#replay")).to_be_disabled()
        expect(page.locator("#download")).to_have_attribute("aria-disabled", "true")
        say(page, "Once more.")
        first = page.locator("#picture").get_attribute("data-utterance")
        wait_for_state(page, "idle")
        page.wait_for_selector("#download[href]")
        with page.expect_download() as downloading:
            page.click("#download")
        downloaded = Path(downloading.value.path()).read_bytes()
        assert downloading.value.suggested_filename.endswith(".mp4")
        assert downloaded[4:8] == b"ftyp"
        page.click("#replay")
        page.wait_for_selector(f"#picture:not([data-utterance='{first}'])")
        wait_for_state(page, "idle")


def test_captions_follow_the_switch(open_page: Open) -> None:
    with open_page() as page:
        say(page, "Read my lips, or read this.")
        expect(page.locator("#caption")).to_have_text("Read my lips, or read this.")
        page.click("#captions")
        expect(page.locator("#caption")).to_be_hidden()
        wait_for_state(page, "idle")


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


def test_parts_that_cannot_be_read_are_named(open_page: Open) -> None:
    with open_page() as page:
        say(page, "Hello 🙂 world.")
        expect(page.locator("#notice")).to_contain_text("🙂")
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


def report_path(request: Request) -> str:
    path: str = request.response().json()["urls"]["self"]  # type: ignore[union-attr]
    return path


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


# Speaks without the user having touched anything, and keeps what it saw: asking the page through the debugger counts
# as a touch, so nothing may be asked meanwhile.
SPEAKS_BY_ITSELF = """
  window.seen = [];
  addEventListener('DOMContentLoaded', () => {
    const timer = setInterval(() => {
      if (document.body.dataset.state !== 'idle') return;
      clearInterval(timer);
      document.getElementById('text').value = 'Nobody has touched this page, and yet it wants to speak to you at once.';
      document.getElementById('composer').requestSubmit();
      setInterval(() => {
        const live = document.getElementById('live'), button = document.getElementById('unblock');
        if (document.body.dataset.state === 'speaking')
          window.seen.push({asks: !button.hidden, muted: live.muted, paused: live.paused,
                            touched: navigator.userActivation.hasBeenActive});
      }, 100);
    }, 50);
  });
"""


@pytest.mark.parametrize("transport", ["auto", "mp4"])
def test_blocked_sound_needs_one_click(open_page: Open, transport: str) -> None:
    preference = f"localStorage.setItem('mary.preferences', JSON.stringify({{transport: '{transport}'}}));"
    with open_page(ready=False, script=preference + SPEAKS_BY_ITSELF) as page:
        page.wait_for_timeout(4000)
        page.click("#unblock")
        expect(page.locator("#unblock")).to_be_hidden()
        seen = page.evaluate("seen")
        after = page.evaluate("({muted: live.muted, paused: live.paused})")
        wait_for_state(page, "idle")
    untouched = [one for one in seen if not one["touched"]]
    assert any(one["asks"] and one["muted"] and not one["paused"] for one in untouched)
    assert after == {"muted": False, "paused": False}


def test_the_idle_clip_goes_on_without_a_seam(open_page: Open) -> None:
    with open_page() as page:
        frames = page.evaluate(
            """() => new Promise((resolve) => {
              const idle = document.getElementById('idle'), frames = [];
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
        assert page.evaluate("live.muted")


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
