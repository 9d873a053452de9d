"""`mary evaluate-alignment`: how right the phone times of every engine and aligner are."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from app.align import registry as aligners
from app.align.agreement import Starts, agreement
from app.align.aligner import Aligner
from app.align.clips import find_clips
from app.align.pocketsphinx import PocketSphinxAligner
from app.commands.long_work import LongWork, shown
from app.commands.takes import spoken_takes
from app.config import Settings
from app.errors import InputError, MaryError
from app.evaluation.sentences import SENTENCES
from app.evaluation.timing import TimingRow, aligner_row, engine_row
from app.speech import Speech
from app.tts import registry as engines
from app.tts.engine import SpeechEngine
from app.tts.hibari import HibariEngine
from app.tts.narrate import check
from app.tts.piper_voice import PiperEngine

EXACT = "espeak"
"""The engine that knows its times to the sample."""
SERVERS = frozenset(["openai", "http", "xmlrpc"])
"""Are asked only if they are configured: nobody else's may be."""
UNTRIED = frozenset(["mock", "textgrid"])
"""Do not listen, or only know recordings that have been aligned already."""

RAW_ENGINES: dict[str, Callable[[], SpeechEngine]] = {
    "hibari": lambda: HibariEngine(lag=0.0),
    "piper": lambda: PiperEngine(lag=0.0),
}
RAW_ALIGNERS: dict[str, Callable[[], Aligner]] = {"pocketsphinx": lambda: PocketSphinxAligner(shift=0.0)}
"""Without the constants that such a measurement has found."""

STEPS = {"speaking": 1.0, "aligning": 9.0, "engines": 25.0, "recordings": 10.0}
"""Seconds of each step for a hundred sentences: what the time left is told by."""


@dataclass(frozen=True)
class Measured:
    """Everything that was measured.

    Attributes:
        rows: in the order in which they are shown.
        notes: what was not measured, and why.
    """

    rows: tuple[TimingRow, ...]
    notes: tuple[str, ...]


def run(
    settings: Settings, recordings: Sequence[Path], *, count: int, figures: Path | None, out: Console, err: Console
) -> None:
    """Measure all that is installed, showing progress, and print the table.

    Args:
        settings: options of engines and aligners.
        recordings: videos with word times, or folders of them; may be none.
        count: sentences to speak.
        figures: JSON file to write, if any.
        out, err: where table and progress go.

    Raises:
        InputError: nothing can be measured, or the file cannot be written.
    """
    if figures is not None and not figures.absolute().parent.is_dir():
        raise InputError(f"{figures} cannot be written", field="json", advice="Name a file in a folder that exists.")
    sentences = [SENTENCES[number % len(SENTENCES)] for number in range(count)]
    with shown(err, LongWork(STEPS)) as work, ExitStack() as opened:
        found = _measure(settings, sentences, recordings, opened, work.tell)
    if not found.rows:
        raise InputError("there is nothing to measure", advice="; ".join(found.notes))
    out.print(table(found.rows))
    for note in found.notes:
        out.print(Text(note, style="italic"), soft_wrap=True)
    if figures is not None:
        figures.write_text(json.dumps([asdict(row) for row in found.rows], indent=2) + "\n", encoding="utf-8")


def _measure(
    settings: Settings,
    sentences: Sequence[str],
    recordings: Sequence[Path],
    opened: ExitStack,
    tell: Callable[[str, float], None],
) -> Measured:
    notes: list[str] = []
    listening = _aligners(settings, opened, notes)
    rows = list(_aligner_rows(listening, _exact(settings, sentences, opened, notes, tell), opened, tell))
    judge = listening.get(settings.align.engine)
    if judge is None:
        notes.append(f"engines and recordings are not measured: aligner {settings.align.engine} cannot be used")
        return Measured(tuple(rows), tuple(notes))
    names = [name for name in engines.names() if name not in (*UNTRIED, EXACT) and usable(name, settings)]
    for number, name in enumerate(names):
        tell("engines", number / len(names))
        rows += _engine_rows(name, settings, sentences, judge, notes)
    if recordings:
        tell("recordings", 0.0)
        rows += _recorded(recordings, judge.name)
    return Measured(tuple(rows), tuple(notes))


def usable(engine: str, settings: Settings) -> bool:
    """Whether an engine may be asked."""
    return engine not in SERVERS or engine in settings.speech.engines or engine == settings.speech.engine


def _aligners(settings: Settings, opened: ExitStack, notes: list[str]) -> dict[str, Aligner]:
    """All that can be used, by name; closed with `opened`."""
    made: dict[str, Aligner] = {}
    for name in aligners.names():
        if name in UNTRIED or (name in SERVERS and name not in settings.align.aligners):
            continue
        try:
            made[name] = aligners.create(name, settings.align.aligners.get(name, {}))
        except MaryError as error:
            notes.append(f"aligner {name} is not measured: {error.message}")
        else:
            opened.callback(getattr(made[name], "close", _nothing))
    return made


def _exact(
    settings: Settings,
    sentences: Sequence[str],
    opened: ExitStack,
    notes: list[str],
    tell: Callable[[str, float], None],
) -> list[tuple[str, Speech]]:
    """The sentences with times that are exact; none if what knows them is not installed."""
    spoken: list[tuple[str, Speech]] = []
    try:
        engine = opened.enter_context(closing(engines.create(EXACT, settings.speech.engines.get(EXACT, {}))))
        for number, text in enumerate(sentences):
            tell("speaking", number / len(sentences))
            spoken.append((text, check(engine.speak(text), EXACT)))
    except MaryError as error:
        notes.append(f"aligners are not measured: {error.message}. {error.advice}".rstrip())
        return []
    return spoken


def _aligner_rows(
    listening: Mapping[str, Aligner],
    exact: Sequence[tuple[str, Speech]],
    opened: ExitStack,
    tell: Callable[[str, float], None],
) -> Iterator[TimingRow]:
    if not exact:
        return
    for number, (name, aligner) in enumerate(listening.items()):
        tell("aligning", number / len(listening))
        yield aligner_row(aligner, exact, EXACT)
        if name in RAW_ALIGNERS:
            raw = RAW_ALIGNERS[name]()
            opened.callback(getattr(raw, "close", _nothing))
            yield aligner_row(raw, exact, EXACT, calibrated=False)


def _engine_rows(
    name: str, settings: Settings, sentences: Sequence[str], judge: Aligner, notes: list[str]
) -> Iterator[TimingRow]:
    try:
        with closing(engines.create(name, settings.speech.engines.get(name, {}))) as engine:
            if not engine.speak(sentences[0]).phones:
                notes.append(f"engine {name} has no times of its own")
                return
            yield engine_row(name, lambda text: check(engine.speak(text), name), sentences, judge)
        if name in RAW_ENGINES:
            with closing(RAW_ENGINES[name]()) as raw:
                yield engine_row(name, raw.speak, sentences, judge, calibrated=False)
    except MaryError as error:
        notes.append(f"engine {name} is not measured: {error.message}")


def _recorded(recordings: Sequence[Path], judge: str) -> Iterator[TimingRow]:
    """The aligner on recordings whose words have times."""
    _, aligned = spoken_takes(find_clips(recordings, []), aligner=judge, cache=None, workers=0, progress=_quiet)
    found = agreement(aligned.spoken)
    if found is None:
        raise InputError("the recordings have no word times to compare with", advice="Give .align or .TextGrid files.")
    for what, distances in (("inner words", found.inner), ("first words", found.onsets)):
        if distances is not None:
            yield TimingRow(
                f"{judge}, {what}", "the recordings", True, len(aligned.spoken), len(aligned.refused), distances
            )


def table(rows: Sequence[TimingRow]) -> Table:
    """The rows to read; times in milliseconds."""
    shown = Table(box=None, pad_edge=False)
    columns = ("starts by", "against", "calibr.", "said", "failed", "starts", "median", "p90", "bias", "> 40")
    for number, column in enumerate(columns):
        shown.add_column(column, justify="right" if number > 2 else "left", no_wrap=number > 0)
    for row in rows:
        figures = _figures(row.starts) if row.starts is not None else ("",) * 5
        yes = "yes" if row.calibrated else "no"
        shown.add_row(row.measured, row.against, yes, str(row.sentences), str(row.failures), *figures)
    return shown


def _figures(found: Starts) -> tuple[str, ...]:
    return (
        f"{found.count:,}",
        f"{found.median:.0f}",
        f"{found.p90:.0f}",
        f"{found.bias:+.0f}",
        f"{100 * found.over_40:.0f} %",
    )


def _nothing() -> None:
    pass


def _quiet(_share: float) -> None:
    pass
