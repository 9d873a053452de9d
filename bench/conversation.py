"""A conversation: how soon live text is answered, how early and exact events are, how fast speech falls silent."""

from __future__ import annotations

import random
import re
import statistics
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.client import Conversation, Mary, Stream
from app.engine.avatar import load_avatar
from bench.flv_reader import AUDIO, VIDEO
from bench.mouth import CLOSED, MouthGauge
from bench.offset import LOUD, last_loud, onset
from bench.recorded import FOLDER
from bench.report import Report
from bench.server import running_server
from bench.sync import PARAGRAPH
from bench.told import Told, conversation
from bench.viewers import FlvViewer
from bench.watched import Watched, look

TOKEN_SECONDS = 0.03
"""Between two tokens of a language model."""
TURNS = (
    ("Well, to begin with,", " I would like a cup of tea."),
    ("If you ask me,", " it will rain tomorrow."),
    ("That is a good question.", " Nobody knows the answer."),
    ("As far as I know,", " the train is late."),
    ("Of course I can help;", " tell me what is wrong."),
    ("On the other hand,", " we could stay at home."),
    ("Please have a seat.", " The doctor will see you soon."),
    ("Once upon a time,", " there was a very small house."),
    ("To be honest with you,", " that was my favourite."),
    ("Good day, everybody.", " Shall we begin?"),
    ("Just in case,", " bring a warm coat along."),
    ("Not at all, my friend:", " take as many as you like."),
)
"""A first clause, and what follows it."""
INTERRUPTIONS = 12
BEFORE_CALL = 0.06
"""Seconds: with sound in them, an interruption falls into the middle of speech."""
AFTER_CALL = 1.2
"""Seconds after an interruption in which it is looked at."""
PAUSE = 0.15
SETTLE = 0.6
"""Seconds between two utterances."""


@dataclass(frozen=True)
class Waited:
    """Milliseconds from the sending of a text to the arrival of its first picture and its first sound."""

    picture: float
    sound: float


def run() -> list[Report]:
    """One idle stream that is watched, written to, told texts, and interrupted."""
    with (
        running_server() as url,
        tempfile.TemporaryDirectory() as folder,
        Mary(url) as mary,
        mary.stream(start="now") as stream,
        conversation(stream) as (talk, told),
        FlvViewer(stream.urls["flv"], Path(folder) / "seen.flv") as viewer,
    ):
        viewer.first(VIDEO, 2.0)
        written, said = [], []
        for clause, rest in TURNS:
            written.append(_write(talk, told, viewer, clause, rest))
            said.append(_say(stream, told, viewer, clause))
        _speak(stream, told, PARAGRAPH)
        calls = _interrupt(stream, told)
        viewer.first(VIDEO, viewer.tags[-1].seconds + AFTER_CALL)
        stream.end()
        told.join()
        viewer.join()
        watched = look(viewer.path, MouthGauge(load_avatar(FOLDER).pack.background))
        return [_latency(written, said), _events(told, viewer, watched), _silence(told, viewer, watched, calls)]


# --- what is done ---------------------------------------------------------------------------------------------------


def _write(talk: Conversation, told: Told, viewer: FlvViewer, clause: str, rest: str) -> Waited:
    mark, completed = told.mark(), 0.0
    tokens, following = (re.findall(r"\s?\w+|[^\w\s]", text) for text in (clause, rest))
    for number, token in enumerate(tokens + following):
        if number == len(tokens):
            completed = time.time()
        talk.write(token)
        time.sleep(TOKEN_SECONDS)
    talk.end()
    return _waited(told, viewer, mark, completed)


def _say(stream: Stream, told: Told, viewer: FlvViewer, text: str) -> Waited:
    mark, sent = told.mark(), time.time()
    stream.say(text)
    return _waited(told, viewer, mark, sent)


def _waited(told: Told, viewer: FlvViewer, mark: int, sent: float) -> Waited:
    _, started = told.wait("speak_started", mark)
    picture, sound = (viewer.first(kind, started["media_time"]).arrived for kind in (VIDEO, AUDIO))
    told.wait("speak_ended", mark, utterance=started["utterance"])
    time.sleep(SETTLE)
    return Waited(1e3 * (picture - sent), 1e3 * (sound - sent))


def _speak(stream: Stream, told: Told, text: str) -> None:
    mark = told.mark()
    told.wait("speak_ended", mark, 120.0, utterance=stream.say(text))
    time.sleep(SETTLE)


def _interrupt(stream: Stream, told: Told) -> list[tuple[float, str]]:
    """Unix time and utterance of interruptions at random moments of speech."""
    chance, calls = random.Random(4), []
    for _ in range(INTERRUPTIONS):
        mark = told.mark()
        utterance = stream.say(PARAGRAPH)
        told.wait("speak_started", mark)
        time.sleep(chance.uniform(1.0, 4.0))
        calls.append((time.time(), utterance))
        stream.interrupt()
        told.wait("speak_ended", mark, utterance=utterance)
        time.sleep(AFTER_CALL)
    return calls


# --- what came of it ------------------------------------------------------------------------------------------------


def _latency(written: list[Waited], said: list[Waited]) -> Report:
    report = Report(
        "live text", f"From the end of the first clause to its first packet over HTTP-FLV, {len(TURNS)} texts"
    )
    for name, measured, bar in (
        ("live text, a token every 30 ms", written, "<= 400"),
        ("say, the clause alone", said, ""),
    ):
        for what in ("picture", "sound"):
            _spread(report, f"{name}, first {what}", [getattr(each, what) for each in measured], bar)
    return report


def _events(told: Told, viewer: FlvViewer, watched: Watched) -> Report:
    report = Report("events", "Word events against the sound of the words")
    words = told.words()
    leads: list[tuple[float, str]] = []
    for arrived, word in words:
        tag = viewer.carrier(AUDIO, word["media_time"])
        if tag is not None:
            leads.append((1e3 * (tag.arrived - arrived), word["text"]))
    least, ahead = min(leads), [each for each, _ in leads]
    note = f"{least[1]!r}; {sum(each < 0 for each in ahead)} of {len(leads)} words came after their sound"
    report.add("event before its sound arrives, least", least[0], "ms", ">= 0", note)
    report.add("event before its sound arrives, median", statistics.median(ahead), "ms")
    off: list[tuple[float, str]] = []
    silent = {data["utterance"]: data["media_time"] - SETTLE / 2 for _, data in told.of("speak_started")}
    for _, word in words:
        before, start = silent[word["utterance"]], word["media_time"]
        silent[word["utterance"]] = word["end_time"]
        heard = onset(watched.sound, before, word["end_time"]) if start - before >= PAUSE else None
        if heard is not None:
            off.append((1e3 * (start - heard), word["text"]))
    worst = max(off, key=lambda each: abs(each[0]))
    pauses = f"{len(off)} words after a pause of {PAUSE} s; sound: above {LOUD:g} dB"
    report.add("word's time off its sound, median", statistics.median(abs(each) for each, _ in off), "ms", note=pauses)
    report.add("word's time off its sound, worst", abs(worst[0]), "ms", "<= 100", f"{worst[1]!r}, {worst[0]:+.0f} ms")
    report.add("word's time against its sound, mean", float(np.mean([each for each, _ in off])), "ms", note="+ is late")
    return report


def _silence(told: Told, viewer: FlvViewer, watched: Watched, calls: Sequence[tuple[float, str]]) -> Report:
    report = Report(
        "interrupt", "From calling POST /interrupt to silence and to the closed mouth, on the stream's clock"
    )
    started = {data["utterance"]: data for _, data in told.of("speak_started")}
    sounds, pictures, shown = [], [], []
    for called, utterance in calls:
        clock = called - started[utterance]["wall_ms"] / 1e3 + started[utterance]["media_time"]
        loud = last_loud(watched.sound, clock - BEFORE_CALL, clock + AFTER_CALL)
        if loud is not None:
            sounds.append(1e3 * (loud - clock))
        mouth = watched.mouth.within(clock, clock + AFTER_CALL)
        unclosed = np.flatnonzero(mouth.values > CLOSED)
        first = unclosed[-1] + 1 if len(unclosed) else 0
        if first == len(mouth.times):
            raise ValueError(f"the mouth did not close within {AFTER_CALL} s of an interruption at {clock:.2f} s")
        closed = float(mouth.times[first])
        pictures.append(1e3 * (closed - clock))
        shown.append(1e3 * (viewer.first(VIDEO, closed).arrived - called))
    _spread(report, "last loud sound", sounds, "<= 80", f"{len(sounds)} of {len(calls)} in the middle of sound")
    _spread(report, "first picture with the mouth closed for good", pictures, "<= 200", f"{len(pictures)} times")
    _spread(report, "arrival of that picture", shown)
    idle = watched.mouth.within(0.0, min(data["media_time"] for data in started.values()))
    report.add("mouth of idle pictures, most", idle.values.max(), "levels", f"<= {CLOSED}", "what is taken for closed")
    return report


def _spread(report: Report, name: str, values: Sequence[float], bar: str = "", note: str = "") -> None:
    worst = f"{min(values):.0f} to {max(values):.0f}" + (f"; {note}" if note else "")
    report.add(f"{name}, p50", float(np.percentile(values, 50)), "ms")
    report.add(f"{name}, p95", float(np.percentile(values, 95)), "ms", bar, worst)
