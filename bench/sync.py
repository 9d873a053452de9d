"""A minute of speech as a file: sound and picture end together."""

from __future__ import annotations

import json
import shutil
import tempfile
import urllib.request
from pathlib import Path

import av

from app.config import Settings
from app.engine.avatar import load_avatar
from app.engine.pool import OrderedPool
from app.stream.render import render_file
from app.tts.narrate import narrate
from app.tts.registry import create
from bench.recorded import FOLDER
from bench.report import Report
from bench.server import running_server

PARAGRAPH = (
    "The lighthouse keeper woke before dawn and climbed the hundred and twelve steps to the lamp. "
    "She wiped the salt from the glass, wound the clockwork, and wrote the weather into her book. "
    "By noon the fog had come in from the west, and three boats were still out beyond the reef. "
    "Nobody on shore could see them, but everybody could hear the slow bell of the nearest one. "
    "She lit the lamp again in the middle of the day, which she had done only twice before. "
    "One after another the boats turned towards the light, and by four o'clock all of them were home. "
    "That evening the fishermen brought her bread, butter, and a very large smoked mackerel. "
    "She thanked them, put the kettle on, and asked who had been ringing the bell. "
    "They looked at each other for a while, because none of the boats had ever carried one. "
)


def run() -> list[Report]:
    """Render a minute, and watch it live, and compare where the tracks end."""
    report = Report("sync", "Sound and picture of one long utterance: where they end")
    text = PARAGRAPH * 2
    avatar = load_avatar(FOLDER)
    pool = OrderedPool(2)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "minute.mp4"
        render_file(avatar, narrate(create("hibari"), text), Settings(), path, pool)
        pool.close()
        _compare(report, "rendered file", path)
        with running_server() as base:
            order = json.dumps({"text": text, "once": True}).encode()
            request = urllib.request.Request(f"{base}/v1/streams", order, {"Content-Type": "application/json"})
            with urllib.request.urlopen(request, timeout=10) as answer:
                urls = json.load(answer)["urls"]
            for name, url in (("live.flv, watched to its end", "flv"), ("video.mp4 of it", "video")):
                path = Path(folder) / "watched"
                with urllib.request.urlopen(base + urls[url], timeout=60) as answer, path.open("wb") as file:
                    shutil.copyfileobj(answer, file)
                _compare(report, name, path)
    return [report]


def _compare(report: Report, name: str, path: Path) -> None:
    ends: dict[str, float] = {}
    with av.open(str(path)) as container:
        for packet in container.demux():
            if packet.pts is not None and packet.size:
                frame = packet.duration or (1 / FPS if packet.stream.type == "video" else AAC_FRAME) / packet.time_base
                end = float((packet.pts + frame) * packet.time_base)
                ends[packet.stream.type] = max(ends.get(packet.stream.type, 0.0), end)
    report.add(f"{name}, length", ends["video"], "s", ">= 60")
    report.add(f"{name}, picture and sound end apart by", abs(ends["video"] - ends["audio"]) * 1e3, "ms", "<= 40")


FPS = 25
AAC_FRAME = 1024 / 48_000
"""Seconds; FLV packets do not say how long they last."""
