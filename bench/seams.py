"""The idle clip, the live picture, and back again, as a viewer in headless Chromium sees it; and how fast she stops.

Everything is measured on what is shown at each refresh of the display (bench/seam_probe.js). The reference for the head
is the idle clip's own motion, in the same browser.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from bench.latency import CHROMIUM, FLAGS
from bench.report import Report
from bench.server import running_server
from bench.sync import PARAGRAPH

FRAMES = 125
FRAME_MS = 40.0
REFRESH_MS = 20.0
"""A refresh of the display lasts no longer than this; what is longer is the browser's own stutter and not counted."""
AROUND_MS = 600.0
"""Before and after a seam, in which the picture must go on."""
SAMPLES = 9
"""Frames on either side whose times tell the phase."""

UTTERANCES = 20
INTERRUPTS = 12
TEXTS = ("Good morning.", "Yes, of course.", "That is a very good question, thank you.", "Let me think about it.")


@dataclass(frozen=True)
class Look:
    """What is seen at a refresh of the display; see seam_probe.js."""

    at: float
    live: bool
    frame: float | None
    since: float | None
    light: float | None
    moved: float | None
    apart: float | None


@dataclass(frozen=True)
class Seam:
    """One change between the idle clip and the live picture.

    Attributes:
        to_live: which way.
        phase: frames of the loop by which the second is ahead of where the first would be.
        still: longest time in which the picture did not change around it, without the display's own stutter, ms.
        moved: how far the head moved across it, pixels.
        since: how long the picture before it had stood, ms.
        darkest: light of the darkest look around it.
    """

    to_live: bool
    phase: float
    still: float
    moved: float
    since: float
    darkest: float


def watch(page: Page) -> None:
    """Begin to look at the page's avatar."""
    script = (Path(__file__).parent / "seam_probe.js").read_text(encoding="utf-8")
    page.evaluate(f"() => {{ {script}\n window.probe = watch(document.querySelector('mary-avatar')); }}")


def looks(page: Page) -> list[Look]:
    """What was seen since the last call."""
    return [Look(**look) for look in page.evaluate("probe.take()")]


def seams(seen: list[Look]) -> Iterator[Seam]:
    """The changes among looks that follow each other."""
    for n, (before, after) in enumerate(pairwise(seen), 1):
        if before.live == after.live:
            continue
        around = [each for each in seen if abs(each.at - after.at) <= AROUND_MS]
        yield Seam(
            to_live=after.live,
            phase=_phase(seen[:n], seen[n:], after.live),
            still=longest_still(around),
            moved=after.moved or 0.0,
            since=after.at - next((each.at for each in reversed(seen[:n]) if each.moved is not None), before.at),
            darkest=min(each.light for each in around if each.light is not None),
        )


def longest_still(seen: list[Look]) -> float:
    """The longest time for which a picture stood, in ms."""
    still = longest = 0.0
    for before, after in pairwise(seen):
        still += min(REFRESH_MS, after.at - before.at)
        longest = max(longest, still)
        if after.moved is not None:
            still = 0.0
    return longest


def own_motion(idle: list[Look], milliseconds: float) -> float:
    """How far the head moves at most in so long, in pixels."""
    steps = [(look.at, look.moved) for look in idle if look.moved is not None]
    return max(sum(moved for at, moved in steps[: n + 1] if steps[n][0] - at < milliseconds) for n in range(len(steps)))


def _phase(before: list[Look], after: list[Look], to_live: bool) -> float:
    first = [each for each in before if each.live != to_live]
    second = [each for each in after if each.live == to_live]
    ahead = _offset(_arrivals(second)[:SAMPLES]) - _offset(_arrivals(first)[-SAMPLES:])
    return float((ahead + FRAMES / 2) % FRAMES - FRAMES / 2)


def _arrivals(seen: list[Look]) -> list[Look]:
    """Looks at which another frame had come up."""
    return [look for before, look in pairwise(seen) if look.frame is not None and look.frame != before.frame]


def _offset(arrivals: list[Look]) -> float:
    """Loop frame at time 0, in the middle of what some frames say: each is seen a refresh earlier or later."""
    frames = np.array([each.frame for each in arrivals], float)
    frames = frames[0] + (frames - frames[0] + FRAMES / 2) % FRAMES - FRAMES / 2  # unwrapped
    return float(np.median(frames - np.array([each.since for each in arrivals]) / FRAME_MS))


def say(page: Page, text: str) -> None:
    """Have `text` said to its end."""
    page.evaluate("(text) => void document.querySelector('mary-avatar').say(text, {interrupt: true})", text)
    page.locator("body[data-state=speaking]").wait_for()
    page.locator("body[data-state=idle]").wait_for()


def closed_level(seen: list[Look]) -> float:
    """How far apart both mouths look when both are closed: in the last looks of what was said to its end."""
    ends = [n for n, (before, after) in enumerate(pairwise(seen), 1) if before.live and not after.live]
    return statistics.median(look.apart for n in ends for look in seen[n - 3 : n] if look.apart is not None)


def closed_after(seen: list[Look], stopped: float, tolerance: float) -> float:
    """Milliseconds from page time `stopped` to the first look at a closed mouth, after which it stays closed."""
    later = [look for look in seen if look.at >= stopped]
    still_open = [look for look in later if look.live and look.apart is not None and look.apart > tolerance]
    closed = [look for look in later if not still_open or look.at > still_open[-1].at]
    return closed[0].at - stopped


def run() -> list[Report]:
    """Twenty utterances and some interruptions, over WebRTC and over fragmented MP4."""
    reports = []
    with running_server() as base, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        for transport in ("webrtc", "mp4"):
            page = browser.new_page(viewport={"width": 900, "height": 640})
            page.goto(base)
            page.locator("body[data-state=idle]").wait_for()
            page.locator("summary").click()
            page.locator("#transport").select_option(transport)
            page.locator("summary").click()
            report = Report("seams", f"Idle clip to live picture and back in headless Chromium, {transport}")
            _handovers(page, report)
            _interruptions(page, report)
            page.close()
            reports.append(report)
        browser.close()
    return reports


def _handovers(page: Page, report: Report) -> None:
    watch(page)
    for text in TEXTS:  # connects, and learns how late the live picture comes
        say(page, text)
    page.wait_for_timeout(1000)
    looks(page)
    page.wait_for_timeout(11_000)  # two turns of the loop
    idle = looks(page)
    found: list[Seam] = []
    for n in range(UTTERANCES):
        say(page, TEXTS[n % len(TEXTS)])
        page.wait_for_timeout(900 + 137 * n % 700)
        found += seams(looks(page))
    for to_live, name in ((True, "idle to live"), (False, "live to idle")):
        those = [seam for seam in found if seam.to_live is to_live]
        phases = [abs(seam.phase) for seam in those]
        report.add(
            f"{name}, phase error, largest of {len(those)}",
            max(phases),
            "frames",
            "<= 1",
            f"median {statistics.median(phases):.2f}",
        )
        report.add(
            f"{name}, longest picture around it",
            max(seam.still for seam in those),
            "ms",
            "<= 80",
            f"idle clip alone {longest_still(idle):.0f}, median {statistics.median(seam.still for seam in those):.0f}",
        )
        worst = max(those, key=lambda seam: seam.moved / own_motion(idle, seam.since))
        own = own_motion(idle, worst.since)
        report.add(
            f"{name}, head moves across it",
            worst.moved / own,
            "of the loop's most",
            "<= 1",
            f"{worst.moved:.2f} px in {worst.since:.0f} ms; the loop alone up to {own:.2f} px",
        )
    light = statistics.median(look.light for look in idle if look.light is not None)
    report.add(
        "light of the darkest picture around a seam", min(seam.darkest for seam in found) / light, "of normal", ">= 0.9"
    )


def _interruptions(page: Page, report: Report) -> None:
    page.evaluate("probe.lookAtMouths()")
    looks(page)
    for text in TEXTS[:3]:
        say(page, text)
    level = closed_level(looks(page))
    tolerance = 2 * level
    report.add("mouth of the live picture and of the idle clip, both closed, differ by", level, "levels", note="of 255")
    times = []
    for n in range(INTERRUPTS):
        page.evaluate("(text) => void document.querySelector('mary-avatar').say(text)", PARAGRAPH)
        page.locator("body[data-state=speaking]").wait_for()
        page.wait_for_timeout(700 + 211 * n % 900)
        looks(page)
        stopped = page.evaluate("(open) => probe.interrupt(open)", 4 * tolerance)
        page.locator("body[data-state=idle]").wait_for()
        page.wait_for_timeout(700)
        times.append(closed_after(looks(page), stopped, tolerance))
    times.sort()
    report.add(
        "stop() to a closed mouth shown, p95",
        float(np.percentile(times, 95)),
        "ms",
        "<= 200",
        f"p50 {statistics.median(times):.0f}, {len(times)} interruptions with the mouth open",
    )
