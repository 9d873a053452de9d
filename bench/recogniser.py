"""Phones without a transcript: recognisers against the aligner, on a real talker (GRID, if it is there) and on a voice.

What counts is the mouth: how far it opens in the trajectory of the phones heard, against that of the phones aligned.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pocketsphinx
import soxr
from numpy.typing import NDArray

from app.align.clip_sound import read_clip_sound
from app.align.hama import HamaRecogniser
from app.align.live_sound import LiveSound
from app.align.pocketsphinx import PocketSphinxAligner
from app.align.recogniser import RATE, recognise
from app.align.transcript import read_transcript
from app.engine.pack import load_pack
from app.engine.states import viseme
from app.engine.trajectory import GaussianTrajectory
from app.speech import PHONES, SILENCE, Phone
from app.tts.narrate import narrate
from app.tts.planning import plan
from app.tts.registry import create
from bench.report import Report

ROOT = Path(__file__).resolve().parent.parent
GRID = Path(os.environ.get("MARY_GRID") or ROOT.parent / "shared" / "data" / "grid_s1")

SENTENCES = (
    "The quick brown fox jumps over the lazy dog.",
    "Please bring my blue umbrella back before Monday morning.",
    "I would like to know how many people visited the museum last summer.",
    "Maybe the problem is that nobody bothered to ask them.",
    "She sells sea shells by the sea shore, and he buys them.",
    "A pretty good example of humble pie, perhaps.",
    "We have known each other for thirty years, more or less.",
    "Thank you very much for calling, goodbye.",
    "Five brave firefighters finally found the furry puppy.",
    "Why would you want to move the whole house to Wyoming?",
    "The weather tomorrow will be mostly cloudy with some rain in the afternoon.",
    "My mother makes marmalade in the month of May.",
)
STEP = 0.010  # 10 ms: the grid on which phones are compared
LAGS = range(-3, 4)  # frames by which the mouth may be late

Samples = NDArray[np.float32]
Hearing = Callable[["Said"], Sequence[Phone]]


@dataclass(frozen=True)
class Said:
    """Sound at `RATE`, what is said, and its phones."""

    samples: Samples
    text: str
    phones: tuple[Phone, ...]

    @property
    def duration(self) -> float:
        return len(self.samples) / RATE


def run() -> list[Report]:
    """A report for each kind of speech."""
    hama = HamaRecogniser()
    hama.warm_up()
    longest: list[float] = []
    ways: dict[str, Hearing] = {
        "hama, whole": lambda said: recognise(hama, said.samples),
        "hama, live": lambda said: _live(hama, said, "", longest),
        "hama, live with the text": lambda said: _live(hama, said, said.text, longest),
        "pocketsphinx, phones": _Sphinx(allphone=_model("en-us-phone.lm.bin")),
        "pocketsphinx, words": _Sphinx(),
    }
    reports = []
    trajectory = load_pack(ROOT / "avatars" / "mary").trajectory
    for name, clips in (("a real talker (GRID s1, test clips)", _grid()), ("hibari's voice", _voice())):
        report = Report("recogniser", f"Recognisers on {name}")
        if not clips:
            report.title += f": none in {GRID} (MARY_GRID names another folder)"
        for way, hear in ways.items() if clips else ():
            _measure(report, way, hear, clips, trajectory)
        reports.append(report)
    reports[-1].add(
        "longest wait from sound pushed to speech given out", 1000 * max(longest), "ms", "<= 600", "of sound"
    )
    reports[-1].add("memory of a process that hears (hama)", _memory(), "MB")
    return reports


def _measure(report: Report, way: str, hear: Hearing, clips: Sequence[Said], trajectory: GaussianTrajectory) -> None:
    started = time.process_time()
    heard = [list(hear(said)) for said in clips]
    spent = time.process_time() - started
    wrong = total = 0
    same: list[NDArray[np.bool_]] = []
    ours: list[NDArray[np.float64]] = []
    theirs: list[NDArray[np.float64]] = []
    closed = found = 0
    for said, phones in zip(clips, heard, strict=True):
        due = [phone.symbol for phone in said.phones if phone.symbol != SILENCE]
        wrong += _edits(due, [phone.symbol for phone in _joined(phones) if phone.symbol != SILENCE])
        total += len(due)
        one, other = _visemes(said.phones, said.duration), _visemes(phones, said.duration)
        same.append((one == other)[one != viseme(SILENCE)])
        closed += int((one == viseme("M")).sum())
        found += int(((one == viseme("M")) & (other == viseme("M"))).sum())
        ours.append(_opening(trajectory, phones, said.duration))
        theirs.append(_opening(trajectory, said.phones, said.duration))
    follow = {lag: _correlation(theirs, ours, lag) for lag in LAGS}
    report.add(f"{way}: phones wrong", 100 * wrong / total, "%")
    report.add(f"{way}: mouth shape right while speaking", 100 * float(np.concatenate(same).mean()), "% of time")
    report.add(f"{way}: lips closed when they should be", 100 * found / closed, "% of time")
    bar = ">= 0.65" if way.startswith("hama") else ""
    report.add(f"{way}: opening of the mouth, correlation", follow[0], "", bar)
    report.add(f"{way}: lag with the best correlation", 40 * max(follow, key=follow.__getitem__), "ms")
    report.add(f"{way}: time", spent / sum(said.duration for said in clips), "of the sound's")


# --- what is heard ----------------------------------------------------------------------------------------------------


def _live(hama: HamaRecogniser, said: Said, text: str, longest: list[float]) -> list[Phone]:
    """Pushed in chunks of 20 ms, as a microphone would."""
    sound = LiveSound(hama, RATE, transcript=text, wait=0.0)
    speeches = sound.speeches()
    phones: list[Phone] = []
    at = 0.0

    def take() -> None:
        nonlocal at
        for speech in speeches:
            if speech is None:
                return
            phones.extend(Phone(phone.symbol, at + phone.start, at + phone.end) for phone in speech.phones)
            at += speech.duration

    for start in range(0, len(said.samples), RATE // 50):
        sound.push_audio(said.samples[start : start + RATE // 50])
        longest.append(sound.waiting)
        take()
    sound.end()
    take()
    return phones


class _Sphinx:
    """pocketsphinx without a transcript: a loop of phones, or its language model's words spread evenly."""

    def __init__(self, **options: str) -> None:
        self._decoder = pocketsphinx.Decoder(samprate=RATE, loglevel="FATAL", **options)

    def __call__(self, said: Said) -> list[Phone]:
        self._decoder.start_utt()
        self._decoder.process_raw(np.round(np.clip(said.samples, -1, 1) * 32767).astype("<i2").tobytes(), full_utt=True)
        self._decoder.end_utt()
        phones: list[Phone] = []
        for segment in self._decoder.seg() if self._decoder.hyp() is not None else ():
            known = segment.word in PHONES or segment.word.startswith(("<", "[", "+"))
            symbols = [segment.word] if known else (self._decoder.lookup_word(segment.word) or SILENCE).split()
            edges = np.linspace(segment.start_frame, segment.end_frame + 1, len(symbols) + 1) * STEP
            for symbol, start, end in zip(symbols, edges[:-1], edges[1:], strict=True):
                phones.append(Phone(symbol if symbol in PHONES else SILENCE, float(start), float(end)))
        return phones or [Phone(SILENCE, 0.0, said.duration)]


def _model(name: str) -> str:
    return str(Path(pocketsphinx.__file__).parent / "model" / "en-us" / name)


def _grid() -> list[Said]:
    clips = []
    with PocketSphinxAligner() as aligner:
        for path in sorted((GRID / "test").glob("*.mpg")):
            sound, text = read_clip_sound(path), read_transcript(path.with_suffix(".align")).text
            samples = soxr.resample(sound.samples, sound.rate, RATE).astype(np.float32)
            clips.append(Said(samples, text, aligner.align(samples, RATE, text).phones))
    return clips


def _voice() -> list[Said]:
    engine = create("hibari")
    engine.warm_up()
    said = []
    for text in SENTENCES:
        for speech in narrate(engine, plan(text), voice="heart", speed=1.0):
            samples = soxr.resample(speech.samples, speech.rate, RATE).astype(np.float32)
            said.append(Said(samples, text, speech.phones))
    return said


def _memory() -> float:
    code = (
        "import numpy; from app.align.hama import HamaRecogniser; "
        "HamaRecogniser().hear(numpy.random.default_rng(0).normal(0, 0.1, 32000).astype('f')); "
        "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))"
    )
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
        out = subprocess.run(
            [sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True, check=True
        )
    return int(out.stdout) / 1024


# --- comparing --------------------------------------------------------------------------------------------------------


def _joined(phones: Sequence[Phone]) -> list[Phone]:
    """Phones that live sound cut in two are one again."""
    joined: list[Phone] = []
    for phone in phones:
        if joined and joined[-1].symbol == phone.symbol:
            joined[-1] = Phone(phone.symbol, joined[-1].start, phone.end)
        else:
            joined.append(phone)
    return joined


def _visemes(phones: Sequence[Phone], duration: float) -> NDArray[np.int64]:
    times = (np.arange(int(duration / STEP)) + 0.5) * STEP
    at = np.minimum(np.searchsorted([phone.end for phone in phones], times), len(phones) - 1)
    return np.array([viseme(phones[number].symbol) for number in at])


def _opening(trajectory: GaussianTrajectory, phones: Sequence[Phone], duration: float) -> NDArray[np.float64]:
    """How far the mouth is open in each picture: 0 as on average in M, B and P, 1 as in AA."""
    closed, opened = (
        np.mean([mean for mean, state in zip(trajectory.mean, trajectory.states, strict=True) if _of(state, kind)], 0)
        for kind in (("M", "B", "P"), ("AA",))
    )
    axis = (opened - closed) / np.square(opened - closed).sum()
    rows = trajectory.predict(_joined(phones), int(duration * trajectory.fps))
    return np.asarray(((rows - trajectory.offset) / trajectory.scale - closed) @ axis)


def _of(state: str, kind: tuple[str, ...]) -> bool:
    return state.partition(".")[0] in kind


def _correlation(due: Sequence[NDArray[np.float64]], made: Sequence[NDArray[np.float64]], lag: int) -> float:
    one = np.concatenate([row[5:-5] for row in due])
    other = np.concatenate([row[5 + lag : len(row) - 5 + lag] for row in made])
    return float(np.corrcoef(one, other)[0, 1])


def _edits(one: Sequence[str], other: Sequence[str]) -> int:
    row = np.arange(len(other) + 1)
    for number, symbol in enumerate(one, 1):
        before, row[0] = row.copy(), number
        for column, due in enumerate(other, 1):
            row[column] = min(before[column] + 1, row[column - 1] + 1, before[column - 1] + (symbol != due))
    return int(row[-1])
