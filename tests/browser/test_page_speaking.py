"""Typing a sentence, seeing and hearing Mary say it."""

from __future__ import annotations

import statistics
from itertools import pairwise
from pathlib import Path

import pytest
from page_steps import SENTENCE, Open, choose, look, report_on, say, streams_asked_for, wait_for_state
from playwright.sync_api import expect

NO_GESTURE_NEEDED = "--autoplay-policy=no-user-gesture-required"
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
  const picture = document.getElementById('picture');
  const live = picture.shadowRoot.getElementById('live'), idle = picture.shadowRoot.getElementById('idle');
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
    const shown = picture.live ? 'live' : 'idle';
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


def test_parts_that_cannot_be_read_are_named(open_page: Open) -> None:
    with open_page() as page:
        say(page, "Hello 🙂 world.")
        expect(page.locator("#notice")).to_contain_text("🙂")
        wait_for_state(page, "idle")


SPEAKS_BY_ITSELF = """
  window.seen = [];
  addEventListener('DOMContentLoaded', () => {
    const timer = setInterval(() => {
      if (document.body.dataset.state !== 'idle') return;
      clearInterval(timer);
      document.getElementById('text').value = 'Nobody has touched this page, and yet it wants to speak to you at once.';
      document.getElementById('composer').requestSubmit();
      setInterval(() => {
        const {shadowRoot} = document.getElementById('picture');
        const live = shadowRoot.getElementById('live'), button = shadowRoot.getElementById('unblock');
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
        after = page.locator("#live").evaluate("(live) => ({muted: live.muted, paused: live.paused})")
        wait_for_state(page, "idle")
    untouched = [one for one in seen if not one["touched"]]
    assert any(one["asks"] and one["muted"] and not one["paused"] for one in untouched)
    assert after == {"muted": False, "paused": False}
