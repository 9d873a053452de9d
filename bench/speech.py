"""Speech engines and aligners: how soon a sentence is there, how right its times are, what they hold up."""

from __future__ import annotations

import asyncio
import statistics
import time
from collections.abc import Callable
from contextlib import closing

from app.align import registry as aligners
from app.align.aligner import Aligner
from app.commands.evaluate_alignment import usable
from app.config import load
from app.errors import MaryError
from app.evaluation.sentences import SENTENCES
from app.evaluation.timing import aligner_row, engine_row
from app.speech import Speech
from app.tts import registry as engines
from app.tts.engine import SpeechEngine
from bench.report import Report

TEN_WORDS = tuple(sentence for sentence in SENTENCES if len(sentence.split()) == 10)
"""What the first audio is measured on."""
TIMED = 40
"""Sentences of an engine that are laid beside the aligner's times."""
HELD = 12
"""Sentences during which the event loop is watched."""
TICK = 0.001
"""Seconds that the watched event loop sleeps between two looks at the clock."""
EXACT = "espeak"


def run() -> list[Report]:
    """Measure the default engine, and all others that are installed."""
    settings = load()
    report = Report("speech", "Speech engines and aligners (Fu 2011, table 5.1: 0.3 to 1.2 s for speech and its times)")
    default = settings.speech.engine
    others = [name for name in engines.names() if name not in (default, "mock") and usable(name, settings)]
    with closing(aligners.create("pocketsphinx")) as aligner:  # type: ignore[type-var]
        _warm(aligner)
        for name in (default, *others):
            try:
                engine = engines.create(name, settings.speech.engines.get(name, {}))
                engine.warm_up()
                engine.speak(SENTENCES[0])
            except MaryError as error:
                report.add(f"{name}: not measured", 0, "", note=error.message[:60])
                continue
            with closing(engine):
                _engine(report, engine, aligner, bars=name == default)
        _aligner(report, aligner)
    return [report]


def _engine(report: Report, engine: SpeechEngine, aligner: Aligner, *, bars: bool) -> None:
    times: list[float] = []
    seconds = 0.0
    for text in TEN_WORDS:
        began = time.perf_counter()
        seconds += engine.speak(text).duration
        times.append(time.perf_counter() - began)
    name = engine.name
    report.add(
        f"{name}: first audio of ten words, median", 1000 * statistics.median(times), "ms", "<= 60" if bars else ""
    )
    report.add(f"{name}: of real time", sum(times) / seconds, "", note=f"{len(times)} sentences, {seconds:.0f} s")
    if engine.speak(SENTENCES[0]).phones:
        starts = engine_row(name, engine.speak, SENTENCES[:TIMED], aligner).starts
        if starts is not None:
            median, most = ("<= 15", "<= 40") if bars else ("", "")
            report.add(f"{name}: phone starts beside pocketsphinx, median", starts.median, "ms", median)
            report.add(f"{name}: 90 %", starts.p90, "ms", most, f"bias {starts.bias:+.0f} ms")
    held, idle = _held_up(engine.speak)
    report.add(f"{name}: event loop held up at most", held, "ms", "<= 20", f"{idle:.1f} ms without")


def _aligner(report: Report, aligner: Aligner) -> None:
    try:
        with closing(engines.create(EXACT)) as engine:
            spoken = [(text, engine.speak(text)) for text in SENTENCES]
    except MaryError as error:
        report.add("pocketsphinx: not measured", 0, "", note=error.message[:60])
        return
    row = aligner_row(aligner, spoken, EXACT)
    if row.starts is not None:
        report.add("pocketsphinx: phone starts beside exact times, median", row.starts.median, "ms", "<= 15")
        report.add("pocketsphinx: 90 %", row.starts.p90, "ms", "<= 45", f"{row.starts.count} phones")
    report.add("pocketsphinx: sentences of a hundred that fail", row.failures, "", "<= 0")
    known: dict[str, Speech] = dict(spoken)
    held, idle = _held_up(lambda text: aligner.align(known[text].samples, known[text].rate, text))
    report.add("pocketsphinx: event loop held up at most", held, "ms", "<= 20", f"{idle:.1f} ms without")


def _held_up(work: Callable[[str], object]) -> tuple[float, float]:
    """Milliseconds by which an event loop is late at most while another thread works, and while none does."""

    async def watched() -> tuple[float, float]:
        idle = await _late(asyncio.sleep(1.0))
        held = await _late(asyncio.to_thread(lambda: [work(text) for text in SENTENCES[:HELD]]))
        return held, idle

    return asyncio.run(watched())


async def _late(while_this: object) -> float:
    task = asyncio.ensure_future(while_this)  # type: ignore[call-overload]
    worst = 0.0
    while not task.done():
        began = time.perf_counter()
        await asyncio.sleep(TICK)
        worst = max(worst, time.perf_counter() - began - TICK)
    await task
    return 1000 * worst


def _warm(aligner: Aligner) -> None:
    warm_up: Callable[[], None] = getattr(aligner, "warm_up", lambda: None)
    warm_up()
