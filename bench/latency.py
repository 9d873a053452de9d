"""Enter to the first live frame in headless Chromium: ten words against three hundred, over both transports."""

from __future__ import annotations

import json
import re
import statistics
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from bench.report import Report
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
    with _server() as base, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        for transport in ("webrtc", "mp4"):
            medians = {}
            for name, text in (("10 words", TEN_WORDS), ("300 words", THREE_HUNDRED_WORDS)):
                page = browser.new_page()
                page.goto(base)
                page.locator("summary").click()
                page.locator("#transport").select_option(transport)
                shown = _measure(page, base, text)
                medians[name] = statistics.median(shown)
                bar = "<= 500" if transport == "webrtc" else ""
                report.add(
                    f"{transport}, {name}, median", medians[name], "ms", bar, f"worst {max(shown):.0f} of {len(shown)}"
                )
                page.close()
            report.add(f"{transport}, 300 words against 10", medians["300 words"] / medians["10 words"], "times")
        browser.close()
        stages = _json(f"{base}/v1/latency")["stages"]
        for stage, figures in stages.items():
            report.add(f"stage {stage}, p50", figures["p50"], "ms after the request", note=f"p95 {figures['p95']:.0f}")
    return [report]


def _measure(page: Page, base: str, text: str) -> list[float]:
    """Milliseconds of `REPEATS` utterances after one that warms the connection up; each is stopped once it is seen."""
    shown: list[float] = []
    for _ in range(REPEATS + 1):
        page.locator("#speak:not([disabled])").wait_for()
        before = {entry["utterance"] for entry in _json(f"{base}/v1/latency")["utterances"]}
        page.locator("#text").fill(text)
        page.locator("#text").press("Enter")
        give_up = time.monotonic() + 20
        while True:
            fresh = [e for e in _json(f"{base}/v1/latency")["utterances"] if e["utterance"] not in before]
            if fresh and "shown" in fresh[-1]["timings"]:
                shown.append(fresh[-1]["timings"]["shown"])
                break
            if time.monotonic() > give_up:
                raise TimeoutError(f"the page showed no live frame within 20 s: {page.locator('#status').inner_text()}")
            time.sleep(0.02)
        page.locator("#stop").click()
        page.wait_for_timeout(1500)
    return shown[1:]


def _json(url: str) -> dict[str, object]:  # type: ignore[type-arg]
    with urllib.request.urlopen(url, timeout=5) as answer:
        return json.load(answer)  # type: ignore[no-any-return]


@contextmanager
def _server() -> Iterator[str]:
    """`mary serve` with its real voice, on a free port."""
    root = Path(__file__).parent.parent
    command = [sys.executable, "-m", "app", "serve", "--host", "127.0.0.1", "--port", "0"]
    process = subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if address := re.search(r"http://127\.0\.0\.1:\d+", line):
                break
        else:
            raise RuntimeError("the server did not start")
        give_up = time.monotonic() + 60
        while True:
            try:
                _json(f"{address[0]}/readyz")
                break
            except OSError:
                if time.monotonic() > give_up:
                    raise
                time.sleep(0.1)
        import threading

        threading.Thread(target=process.stdout.read, daemon=True).start()  # or the pipe fills and the server stops
        yield address[0]
    finally:
        process.terminate()
        process.wait(10)
