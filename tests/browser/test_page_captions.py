"""Captions follow the words as they are heard."""

from __future__ import annotations

import re
import urllib.request
from itertools import groupby
from typing import Any

import pytest
from page_steps import LONG, Open, choose, look, report_path, say, streams_asked_for, wait_for_state
from playwright.sync_api import expect

TEXT = "Read my lips while they move, or read this. Every word is shown when it is heard, and not before."
TOLERANCE = 0.1  # seconds

# For every new live frame: its time on the clock of the picture, and the word that is marked as being said.
WATCH = """() => {
  const root = document.getElementById('picture').shadowRoot;
  const live = root.getElementById('live'), caption = root.getElementById('caption');
  window.frames_seen = [];
  const onFrame = (now, {mediaTime, rtpTimestamp}) => {
    live.requestVideoFrameCallback(onFrame);
    if (!document.getElementById('picture').live) return;
    frames_seen.push({
      seconds: rtpTimestamp === undefined ? mediaTime : rtpTimestamp / 90000,
      word: caption.querySelector('.now')?.textContent ?? '',
      text: caption.textContent, hidden: caption.hidden,
    });
  };
  live.requestVideoFrameCallback(onFrame);
}"""


def words_told(url: str) -> list[tuple[float, str]]:
    """Seconds within the utterance at which each word begins, and the word, from WebVTT with a time before each."""
    with urllib.request.urlopen(url, timeout=10) as answer:
        cues = re.findall(r"^([\d:.]+) --> .*\n(.*)$", answer.read().decode(), re.MULTILINE)
    marked = " ".join(f"<{start}>{text}" for start, text in cues)
    return [(seconds(time), word) for time, word in re.findall(r"<([\d:.]+)>(\S+)", marked)]


def seconds(time: str) -> float:
    hours, minutes, rest = time.split(":")
    return int(hours) * 3600 + int(minutes) * 60 + float(rest)


@pytest.mark.parametrize("transport", ["webrtc", "mp4"])
def test_the_word_marked_is_the_one_being_heard(open_page: Open, server: str, transport: str) -> None:
    with open_page() as page:
        asked = streams_asked_for(page)
        choose(page, transport)
        page.evaluate(WATCH)
        say(page, TEXT)
        look(page, f"captions-{transport}")
        wait_for_state(page, "idle")
        utterance = page.locator("#picture").get_attribute("data-utterance")
        words = words_told(f"{server}{report_path(asked[-1])}/captions.vtt?utterance={utterance}")
        frames: list[dict[str, Any]] = page.evaluate("frames_seen")
        expect(page.locator("#caption")).to_be_hidden()
    assert " ".join(word for _, word in words) == TEXT
    marked = [word for word, _ in groupby(frame["word"] for frame in frames) if word]
    assert marked == [word for _, word in words]

    # A browser that was busy may be late now and then; the captions as a whole may not be.
    in_time = 0
    for frame in frames:
        at = frame["seconds"] - frames[0]["seconds"]
        begun = [word for start, word in words if start <= at + TOLERANCE]
        surely = [word for start, word in words if start <= at - TOLERANCE]
        in_time += frame["word"] in ["", *begun][len(surely) :]
    assert in_time > 0.8 * len(frames)

    # What is read never runs ahead of what is heard, fits two lines, and begins anew with a sentence.
    assert all(not frame["hidden"] for frame in frames if frame["word"])
    texts = [text for text, _ in groupby(frame["text"] for frame in frames)]
    assert not texts[-1].startswith("Read")
    assert texts[-1].endswith("and not before.")


def test_the_switch_hides_them(open_page: Open) -> None:
    with open_page() as page:
        say(page, LONG)
        expect(page.locator("#caption")).to_be_visible()
        page.click("#captions")
        expect(page.locator("#caption")).to_be_hidden()
        page.click("#captions")
        expect(page.locator("#caption")).to_be_visible()
        page.click("#stop")
        expect(page.locator("#caption")).to_be_hidden()
        wait_for_state(page, "idle")
        expect(page.locator("#caption")).to_be_hidden()


def test_they_keep_to_two_lines(open_page: Open) -> None:
    with open_page(width=320, height=640) as page:
        say(
            page, "One sentence of many words that never comes to an end and goes on and on and on until nobody listens"
        )
        page.wait_for_function(
            """() => {
              const caption = document.getElementById('picture').shadowRoot.getElementById('caption');
              const lines = new Set([...caption.children].map((word) => word.offsetTop)).size;
              if (lines > 2) throw new Error(`${lines} lines`);
              window.first ??= caption.firstElementChild?.textContent;
              return lines === 2 && caption.firstElementChild.textContent !== window.first;
            }"""
        )
        look(page, "captions-320x640")
        page.click("#stop")
        wait_for_state(page, "idle")
