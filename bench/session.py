"""A long session in real time: does sound stay with the picture, does anything pile up, at three viewers at once?"""

from __future__ import annotations

import os
import random
import re
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.client import Mary, Refused, Stream
from app.engine.avatar import load_avatar
from bench.conversation import TURNS
from bench.flv_reader import VIDEO
from bench.mouth import MouthGauge
from bench.offset import offset
from bench.recorded import FOLDER
from bench.report import Report
from bench.server import Server, started_server
from bench.sync import PARAGRAPH
from bench.told import Told, conversation
from bench.viewers import FlvViewer, HttpViewer
from bench.watched import Series, look
from bench.webrtc_viewer import WebrtcViewer

MINUTES = float(os.environ.get("MARY_BENCH_MINUTES", "10"))
SEED = 7
WARM = min(120.0, MINUTES * 40)
"""Seconds after which memory is not to grow any more."""
MARGIN = 3.0
"""Seconds at both ends of the stream that are not looked at."""
STRETCH = 60.0
KNOWN = 0.06
"""Seconds by which the sound of half a stretch is moved, to see whether that is found."""
SENTENCES = [*re.findall(r"\S[^.]*\.", PARAGRAPH), *(clause + rest for clause, rest in TURNS)]


@dataclass(frozen=True)
class Sample:
    """The server at some time: seconds on the monotonic clock, MB of memory, threads, open files."""

    at: float
    resident: float
    threads: int
    descriptors: int


def run() -> list[Report]:
    """Talk for `MINUTES`, and compare the beginning with the end."""
    with (
        started_server() as server,
        tempfile.TemporaryDirectory() as folder,
        Mary(server.url) as mary,
        mary.stream(start="now") as stream,
        conversation(stream) as (_, told),
        FlvViewer(stream.urls["flv"], Path(folder) / "seen.flv") as flv,
        HttpViewer(stream.urls["mp4"], Path(folder) / "seen.mp4") as mp4,
        WebrtcViewer(stream.urls["whep"]) as webrtc,
    ):
        with _meter(server) as samples:
            refused = _converse(stream, 60 * MINUTES)
        frames = stream.report()["frames"]
        stream.end()
        webrtc.join()
        for each in (flv, mp4, told):
            each.join()
        return [_sync(told, flv, mp4, webrtc), _server(told, samples, frames, refused), _gaps(flv, mp4, webrtc)]


# --- what is done ---------------------------------------------------------------------------------------------------


def _converse(stream: Stream, seconds: float) -> int:
    """Talk at random; returns how many texts were refused because too many waited."""
    chance, end, refused = random.Random(SEED), time.monotonic() + seconds, 0
    deck: list[str] = []
    while (left := end - time.monotonic()) > 0:
        if not deck:  # every minute has about the same sentences: what is compared is alike
            deck = SENTENCES.copy()
            chance.shuffle(deck)
        try:
            stream.say(deck.pop(), interrupt=chance.random() < 0.15)
        except Refused:
            refused += 1
        time.sleep(min(left, chance.uniform(1.5, 7.5)))
        if chance.random() < 0.2:
            stream.interrupt()
    return refused


@contextmanager
def _meter(server: Server) -> Iterator[list[Sample]]:
    """The server once a second."""
    samples: list[Sample] = []
    over = threading.Event()

    def measure() -> None:
        while not over.wait(1.0):
            samples.append(Sample(time.monotonic(), server.resident(), server.threads(), server.descriptors()))

    thread = threading.Thread(target=measure)
    thread.start()
    try:
        yield samples
    finally:
        over.set()
        thread.join()


# --- what came of it ------------------------------------------------------------------------------------------------


def _sync(told: Told, flv: FlvViewer, mp4: HttpViewer, webrtc: WebrtcViewer) -> Report:
    report = Report("session", f"{MINUTES:g} minutes of talk: sound behind the mouth, in the first and the last minute")
    gauge = MouthGauge(load_avatar(FOLDER).pack.background)
    end = flv.tags[-1].seconds - MARGIN
    first = (MARGIN, min(MARGIN + STRETCH, end))
    last = (max(MARGIN, end - STRETCH), end)
    stretches = {}
    for name, viewer in (("flv", flv), ("mp4", mp4)):
        parts = [look(viewer.path, gauge, *stretch) for stretch in (first, last)]
        stretches[name] = [(part.mouth, part.sound) for part in parts]
        gap = 1e3 * np.diff(parts[0].pictures).max()
        report.add(f"{name}, longest gap between time stamps of pictures", gap, "ms", note="a frame is 40")
    _, started = told.of("speak_started")[0]
    origin = started["wall_ms"] / 1e3 - started["media_time"]
    assert webrtc.arrived is not None
    mouth, sound = webrtc.arrived.mouth.later(-origin), webrtc.arrived.sound.later(-origin)
    stretches["webrtc, by arrival"] = [(mouth.within(*part), sound.within(*part)) for part in (first, last)]
    for name, parts in stretches.items():
        early, late = (1e3 * offset(*part) for part in parts)
        report.add(f"{name}, first minute", early, "ms")
        report.add(f"{name}, last minute", late, "ms", note=f"{late - early:+.1f} ms to the first")
        report.add(f"{name}, difference", abs(late - early), "ms", "<= 40")
    off = max(abs(_known_shift(*part) - KNOWN) for parts in stretches.values() for part in parts)
    note = "halves of all these minutes, the sound of the second half moved"
    report.add(f"error at a known shift of {1e3 * KNOWN:g} ms, worst", 1e3 * off, "ms", "<= 20", note)
    return report


def _known_shift(mouth: Series, sound: Series) -> float:
    """By how much the sound of the second half of a stretch seems to be later, once it is moved by `KNOWN` seconds."""
    start, end = mouth.times[0], mouth.times[-1]
    middle = (start + end) / 2
    return offset(mouth.within(middle, end), sound.later(KNOWN)) - offset(mouth.within(start, middle), sound)


def _server(told: Told, samples: list[Sample], frames: dict[str, int], refused: int) -> Report:
    report = Report("session, server", f"The server after {WARM:g} s and after {MINUTES:g} minutes")
    warm = [each for each in samples if abs(each.at - samples[0].at - WARM) <= 5]
    end = samples[-10:]
    for name, unit in (("resident", "MB"), ("threads", ""), ("descriptors", "")):
        before, after = (float(np.median([getattr(each, name) for each in part])) for part in (warm, end))
        bar = "<= 20" if name == "resident" else ""
        report.add(f"{name}, after the warm-up", before, unit)
        report.add(f"{name}, at the end", after, unit, note=f"most {max(getattr(each, name) for each in samples):.0f}")
        report.add(f"{name}, growth", after - before, unit, bar)
    outcomes = Counter(data["reason"] for _, data in told.of("speak_ended"))
    for reason in ("done", "interrupted", "failed"):
        report.add(f"utterances {reason}", outcomes[reason], "")
    report.add("texts refused", refused, "")
    report.add("errors told", len(told.of("error")), "", "<= 0")
    report.add("frames rendered", frames["rendered"], "")
    report.add("frames dropped", frames["dropped"], "")
    return report


def _gaps(flv: FlvViewer, mp4: HttpViewer, webrtc: WebrtcViewer) -> Report:
    report = Report("session, viewers", "The longest wait of every viewer")
    assert webrtc.arrived is not None
    for name, arrivals in (
        ("flv, between pictures", [tag.arrived for tag in flv.tags if tag.kind == VIDEO]),
        ("mp4, between fragments", [at for at, _ in mp4.arrivals]),
        ("webrtc, between decoded pictures", webrtc.arrived.mouth.times),
    ):
        gaps = 1e3 * np.diff(arrivals)
        report.add(name, gaps.max(), "ms", note=f"99.9 %: {np.percentile(gaps, 99.9):.0f} ms of {len(gaps)}")
    return report
