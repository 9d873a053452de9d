"""Enter to the first live frame in headless Chromium: ten words against three hundred, over both transports."""

from __future__ import annotations

import statistics
import time

from playwright.sync_api import Browser, Page, sync_playwright

from bench.report import Report
from bench.server import fetch, running_server
from bench.sync import PARAGRAPH

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
REPEATS = 10
TEN_WORDS = "Type a short sentence, and she says it right away."
THREE_HUNDRED_WORDS = " ".join((PARAGRAPH * 3).split()[:300])


def run() -> list[Report]:
    """Median and worst of several sentences, each typed into the page."""
    report = Report("latency", "Enter to the first live frame shown, in headless Chromium on the same machine")
    with running_server() as base, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        for transport in ("webrtc", "mp4"):
            medians = {}
            for name, text in (("10 words", TEN_WORDS), ("300 words", THREE_HUNDRED_WORDS)):
                page = browser.new_page()
                page.goto(base)
                page.locator("summary").click()
                page.locator("#transport").select_option(transport)
                _measure(page, base, text, repeats=1)  # connects
                shown = _measure(page, base, text)
                medians[name] = statistics.median(shown)
                bar = "<= 500" if transport == "webrtc" else ""
                report.add(
                    f"{transport}, {name}, median", medians[name], "ms", bar, f"worst {max(shown):.0f} of {len(shown)}"
                )
                page.close()
            report.add(
                f"{transport}, 300 words after 10 words",
                medians["300 words"] - medians["10 words"],
                "ms",
                "<= 40",
                "one frame",
            )
        report.add(
            "webrtc, first words on a fresh page, median", _fresh(browser, base), "ms", "<= 500", "connection included"
        )
        browser.close()
        stages = fetch(f"{base}/v1/latency")["stages"]
        for stage, figures in stages.items():
            report.add(f"stage {stage}, p50", figures["p50"], "ms after the request", note=f"p95 {figures['p95']:.0f}")
    return [report]


def _fresh(browser: Browser, base: str) -> float:
    """Median milliseconds of the first utterance of pages that have just been opened."""
    shown = []
    for _ in range(5):
        page = browser.new_page()
        page.goto(base)
        shown += _measure(page, base, TEN_WORDS, repeats=1)
        page.close()
    return statistics.median(shown)


def _measure(page: Page, base: str, text: str, repeats: int = REPEATS) -> list[float]:
    """Milliseconds of some utterances, each stopped once it is seen."""
    shown: list[float] = []
    for _ in range(repeats):
        page.locator("#speak:not([disabled])").wait_for()
        before = {entry["utterance"] for entry in fetch(f"{base}/v1/latency")["utterances"]}
        page.locator("#text").fill(text)
        page.locator("#text").press("Enter")
        give_up = time.monotonic() + 20
        while True:
            fresh = [e for e in fetch(f"{base}/v1/latency")["utterances"] if e["utterance"] not in before]
            if fresh and "shown" in fresh[-1]["timings"]:
                shown.append(fresh[-1]["timings"]["shown"])
                break
            if time.monotonic() > give_up:
                raise TimeoutError(f"the page showed no live frame within 20 s: {page.locator('#status').inner_text()}")
            time.sleep(0.02)
        page.locator("#stop").click()
        page.wait_for_timeout(1500)
    return shown
