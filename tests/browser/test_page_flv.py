"""The page over HTTP-FLV, which mpegts.js plays."""

from __future__ import annotations

from page_steps import LONG, SENTENCE, Open, choose, enter, report_on, say, streams_asked_for, wait_for_state
from playwright.sync_api import expect

DECODED = """() => {
  const { videoWidth, webkitDecodedFrameCount, webkitAudioDecodedByteCount } =
    document.getElementById("picture").shadowRoot.getElementById("live");
  return [videoWidth, webkitDecodedFrameCount > 10, webkitAudioDecodedByteCount > 0];
}"""


def test_mary_speaks_over_flv(open_page: Open) -> None:
    with open_page() as page:
        asked = streams_asked_for(page)
        choose(page, "flv")
        say(page, SENTENCE)
        page.wait_for_function(f"String(({DECODED})()) === '512,true,true'")
        assert report_on(page, asked[-1])["viewers"] == {"whep": 0, "flv": 1, "mp4": 0, "rtmp": 0, "whip": 0}
        wait_for_state(page, "idle")
        expect(page.locator("#problem")).to_be_hidden()
        assert page.locator("#picture").get_attribute("data-transport") == "flv"
        assert report_on(page, asked[-1])["utterances"][-1]["timings"]["shown"] > 0

        say(page, LONG)
        first = page.locator("#picture").get_attribute("data-utterance")
        enter(page, LONG)  # instead of it
        page.wait_for_selector(f"#picture:not([data-utterance='{first}'])")
        page.click("#stop")
        wait_for_state(page, "idle")
        expect(page.locator("#problem")).to_be_hidden()


def test_without_mpegts_it_is_not_offered(open_page: Open) -> None:
    with open_page() as page:
        choose(page, "flv")
        page.route("**/vendor/mpegts.js", lambda route: route.fulfill(status=404))
        page.reload()
        wait_for_state(page, "idle")
        assert page.locator("#transport").input_value() == "auto"
        assert page.locator("#transport option").evaluate_all("all => all.map(({ value }) => value)") == [
            "auto",
            "webrtc",
            "mp4",
        ]
