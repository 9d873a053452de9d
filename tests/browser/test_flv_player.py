"""HTTP-FLV of a running server in mpegts.js, the copy in static/vendor."""

from __future__ import annotations

import base64
import io
import json
import re
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import av
import pytest
from page_steps import STEP_MS
from playwright.sync_api import Browser, Page

ROOT = Path(__file__).resolve().parents[2]
GROUP_SECONDS = 2.0  # stream.keyframe_seconds
LONG = "This is said at some length, so that there is time to look at it. " * 3

# What the last player gets from the network and what it gives to the browser's decoders is kept, to be compared.
RECORD = """() => {
  window.recorded = { flv: [], video: [], audio: [] };
  const read = ReadableStreamDefaultReader.prototype.read;
  const parts = new Map();
  ReadableStreamDefaultReader.prototype.read = async function () {
    if (!parts.has(this)) parts.set(this, (recorded.flv = []));
    const part = await read.call(this);
    if (part.value) parts.get(this).push(part.value.slice());
    return part;
  };
  const add = MediaSource.prototype.addSourceBuffer;
  MediaSource.prototype.addSourceBuffer = function (type) {
    const buffer = add.call(this, type);
    const append = buffer.appendBuffer;
    const kept = (recorded[type.slice(0, 5)] = []);
    buffer.appendBuffer = function (data) {
      kept.push(new Uint8Array(data.slice(0)));
      return append.call(this, data);
    };
    return buffer;
  };
}"""
PLAY = """(url) => {
  const video = document.createElement("video");
  document.body.replaceChildren(video);
  window.player?.destroy();
  window.frames = [];
  window.told = { errors: [], complete: false };
  const seen = (_, { mediaTime }) => { frames.push(mediaTime); video.requestVideoFrameCallback(seen); };
  video.requestVideoFrameCallback(seen);
  window.player = mpegts.createPlayer({ type: "flv", isLive: true, url }, {
    enableWorker: false, enableStashBuffer: false, lazyLoad: false,
    liveBufferLatencyChasing: true, liveBufferLatencyMaxLatency: 0.6, liveBufferLatencyMinRemain: 0.15,
  });
  player.on(mpegts.Events.MEDIA_INFO, (info) => { told.info = info; });
  player.on(mpegts.Events.LOADING_COMPLETE, () => { told.complete = true; });
  player.on(mpegts.Events.ERROR, (...error) => told.errors.push(error.map(String)));
  player.attachMediaElement(video);
  player.load();
  player.play();
}"""
STATE = """() => {
  const video = document.querySelector("video");
  const end = video.buffered.length ? video.buffered.end(video.buffered.length - 1) : 0;
  return {
    frames: frames.length, first: frames[0], time: video.currentTime, behind: end - video.currentTime,
    decoded: [video.webkitDecodedFrameCount, video.webkitAudioDecodedByteCount], ended: video.ended,
    size: [video.videoWidth, video.videoHeight], ...told,
  };
}"""
RECORDED = """async () => {
  const text = async (parts) => {
    const url = await new Promise((resolve) => {
      const reader = new FileReader();
      reader.onload = () => resolve(reader.result);
      reader.readAsDataURL(new Blob(parts));
    });
    return url.slice(url.indexOf(",") + 1);
  };
  return { flv: await text(recorded.flv), video: await text(recorded.video), audio: await text(recorded.audio) };
}"""


@pytest.fixture
def player(browsers: Callable[..., Browser], server: str) -> Iterator[Page]:
    """A page of the service's origin with nothing but mpegts.js."""
    page = browsers("--autoplay-policy=no-user-gesture-required").new_page()
    page.set_default_timeout(STEP_MS)
    page.goto(f"{server}/healthz")
    page.evaluate(RECORD)
    page.add_script_tag(url="/static/vendor/mpegts.js")
    yield page
    page.close()


@contextmanager
def stream(server: str, **order: object) -> Iterator[dict[str, str]]:
    request = urllib.request.Request(
        f"{server}/v1/streams", json.dumps(order).encode(), {"Content-Type": "application/json"}
    )
    with urllib.request.urlopen(request, timeout=60) as answer:
        urls: dict[str, str] = json.load(answer)["urls"]
    yield urls
    end = urllib.request.Request(server + urls["self"], method="DELETE")
    urllib.request.urlopen(end, timeout=60).close()


def until(page: Page, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    give_up = time.monotonic() + 3 * STEP_MS / 1000
    while not condition(state := page.evaluate(STATE)):
        assert time.monotonic() < give_up, state
        assert state["errors"] == []
        page.wait_for_timeout(50)
    return dict(state)


def flv_times(data: bytes) -> dict[str, dict[bytes, float]]:
    """Seconds on the stream's clock of the pictures and sounds of an FLV by their bytes, where those are unique."""
    found: dict[str, dict[bytes, list[float]]] = {"video": {}, "audio": {}}
    data = data[13:]
    while len(data) > 15 + (size := int.from_bytes(data[1:4], "big")):
        kind, body = data[0], data[11 : 11 + size]
        seconds = int.from_bytes(data[7:8] + data[4:7], "big") / 1000
        if kind == 9 and body[1] == 1:
            found["video"].setdefault(body[5:], []).append(seconds)
        elif kind == 8 and body[1] == 1:
            found["audio"].setdefault(body[2:], []).append(seconds)
        data = data[15 + size :]
    return {
        kind: {packet: all[0] for packet, all in packets.items() if len(all) == 1} for kind, packets in found.items()
    }


def played_later(page: Page) -> dict[str, list[float]]:
    """By how much mpegts.js plays every packet later than the stream's clock says, seconds."""
    recorded = {name: base64.b64decode(text) for name, text in page.evaluate(RECORDED).items()}
    times = flv_times(recorded["flv"])
    later: dict[str, list[float]] = {}
    for kind in ("video", "audio"):
        with av.open(io.BytesIO(recorded[kind]), format="mp4") as container:
            packets = [packet for packet in container.demux(0) if packet.pts is not None]
            found = [(float(packet.pts * packet.time_base), times[kind].get(bytes(packet))) for packet in packets]
        later[kind] = [played - due for played, due in found if due is not None]
    return later


def test_it_plays_with_sound_and_picture_in_step(server: str, player: Page) -> None:
    with stream(server, text=LONG) as urls:
        player.evaluate(PLAY, urls["flv"])
        state = until(player, lambda state: state["frames"] > 50 and state["decoded"][1] > 0)
        assert state["size"] == [512, 512]
        info = state["info"]
        assert (info["hasVideo"], info["hasAudio"], info["fps"], info["audioSampleRate"]) == (True, True, 25, 48_000)
        assert info["videoCodec"].startswith("avc1.42")
        assert info["audioCodec"] == "mp4a.40.2"
        assert player.evaluate("frames.every((time, n) => n === 0 || time > frames[n - 1])")
        until(player, lambda later: later["time"] > state["time"] + 1)
        later = played_later(player)
    assert len(later["video"]) > 50
    assert len(later["audio"]) > 50
    every = later["video"] + later["audio"]
    assert max(every) - min(every) < 0.025  # a packet of sound at most, and rounding


def test_a_late_viewer_starts_at_a_key_frame_and_stays_near_the_live_edge(server: str, player: Page) -> None:
    with stream(server) as urls:
        player.evaluate(PLAY, urls["flv"])
        until(player, lambda state: state["time"] > GROUP_SECONDS + 0.8)
        early = max(flv_times(base64.b64decode(player.evaluate(RECORDED)["flv"]))["video"].values())
        player.evaluate(PLAY, urls["flv"])
        state = until(player, lambda state: state["frames"] > 5)
        assert state["first"] < GROUP_SECONDS  # no later key frame was waited for
        recorded = base64.b64decode(player.evaluate(RECORDED)["flv"])
        first = min(flv_times(recorded)["video"].values())
        assert first > early - GROUP_SECONDS - 0.1
        assert recorded[recorded.index(b"\x17\x01") - 11] == 9  # the first picture is a key frame
        until(player, lambda state: state["time"] > 2 and state["behind"] < 1)


def test_it_sees_the_end(server: str, player: Page) -> None:
    with stream(server, text="One two three.", once=True) as urls:
        player.evaluate(PLAY, urls["flv"])
        state = until(player, lambda state: state["complete"] and (state["ended"] or state["behind"] < 0.1))
        assert state["errors"] == []
        gone = player.evaluate("url => fetch(url).then(({ status }) => status)", urls["flv"])
        assert gone == 410


def test_the_copy_is_the_one_that_is_named() -> None:
    script = (ROOT / "static/vendor/mpegts.js").read_text(encoding="utf-8")
    (named,) = re.findall(r"^mpegts\.js (\S+) \(in this repository", (ROOT / "NOTICE").read_text(), re.MULTILINE)
    assert f'"{named}"' in script
    assert f"mpegts.js {named} " in (ROOT / "static/vendor/mpegts.LICENSE.txt").read_text(encoding="utf-8")
