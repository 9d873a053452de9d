"""A real talker from end to end: time and memory of `mary train`, and how well the avatar says unheard sentences.

The recordings (`MARY_GRID`, or `shared/data/grid_s1` beside the repository) are not part of the project; without them
there is nothing to measure.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.align.agreement import agreement
from app.align.clips import find_clips
from app.commands.takes import spoken_takes
from app.engine.evaluation.measure import Measured, measure
from app.engine.evaluation.speech import Predict
from app.engine.evaluation.talker import Talker
from app.engine.metrics import trajectory_scores
from app.engine.models.model import Spoken
from app.engine.pack import FPS, load_pack
from app.engine.training.articulation import LEAD, SMOOTHNESS, TRAINED_SMOOTHNESS, predicted_by, spoken_passages
from app.engine.training.fit_trajectory import Options, fit_trajectory, untrained
from app.engine.training.footage import shots
from app.engine.training.take import Take
from app.engine.training.train import learn
from app.engine.training.workspace import Workspace
from app.engine.trajectory import GaussianTrajectory
from bench.report import Report

ROOT = Path(__file__).resolve().parent.parent
GRID = Path(os.environ.get("MARY_GRID") or ROOT.parent / "shared" / "data" / "grid_s1")
LEADING = "leading modes"


def run() -> list[Report]:
    """Train on the talker's training part, measure on the test part."""
    report = Report("talker", "A real talker (GRID s1): trained on train/, measured on test/")
    if not (GRID / "train").is_dir():
        print(f"no recordings of the GRID corpus in {GRID} (MARY_GRID names another folder): nothing to measure")
        return []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _train(report, folder / "s1")
        test, aligned = spoken_takes(
            find_clips([GRID / "test"]), aligner="pocketsphinx", cache=None, workers=0, progress=lambda _: None
        )
        talker = Talker.of(load_pack(folder / "s1"))
        models = _baselines(folder)
        measured = measure(talker, test, Workspace(folder / "test"), models=models)
        _figures(report, measured)
        found = agreement(aligned.spoken)
        if found is not None and found.inner is not None and found.onsets is not None:
            report.add("inner word starts, off the corpus's own", found.inner.median, "ms", "<= 25", "median")
            report.add("first words", found.onsets.median, "ms", "<= 60", "median")
    return [report]


def _train(report: Report, output: Path) -> None:
    """Time and memory of the command, beside the mere decoding of its pictures in this process."""
    begin = time.monotonic()
    for path in sorted((GRID / "train").glob("*.mpg")):
        for _ in shots(path):
            pass
    decoding = time.monotonic() - begin
    call = [
        sys.executable, "-m", "app", "train", str(GRID / "train"), "-o", str(output), "--subject", "GRID s1",
        "--consent", "measuring",
    ]  # fmt: skip
    begin = time.monotonic()
    process = subprocess.Popen(call, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    peak = 0.0
    done = threading.Event()

    def watch() -> None:
        nonlocal peak
        while not done.wait(0.5):
            peak = max(peak, sum(_memory(number) for number in _family(process.pid)))

    watcher = threading.Thread(target=watch)
    watcher.start()
    _, errors = process.communicate()
    taken = time.monotonic() - begin
    done.set()
    watcher.join()
    if process.returncode:
        raise RuntimeError(f"training failed: {errors}")
    report.add("mary train, 250 clips of 3 s", taken, "s", "<= 480", f"decoding the pictures alone: {decoding:.0f} s")
    report.add("memory of all its processes together", peak, "MB", "<= 1500", "shared pages counted once")


def _family(number: int) -> Iterator[int]:
    """A process and all its descendants."""
    yield number
    for task in Path(f"/proc/{number}/task").glob("*/children"):
        try:
            for child in task.read_text().split():
                yield from _family(int(child))
        except OSError:
            continue


def _memory(number: int) -> float:
    """Proportional set size, MB."""
    try:
        lines = Path(f"/proc/{number}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("Pss:")), 0.0)


PLAIN, TRAINED = "one Gaussian a phone, smoothed (eq. 3.2)", "the same, trained by gradient"


def _baselines(folder: Path) -> dict[str, Predict]:
    """Fu 2011's model with its smoothing tuned on every sixth sentence, and the same trained by gradient."""
    takes, _ = spoken_takes(
        find_clips([GRID / "train"]), aligner="pocketsphinx", cache=None, workers=0, progress=lambda _: None
    )
    spoken, rest = _coefficients(takes, folder)
    learnt = [each for number, each in enumerate(spoken) if number % 6]
    tried = [Options(lead=lead, smoothness=smoothness, contexts=False) for lead in LEAD for smoothness in SMOOTHNESS]
    errors = [_error(untrained(learnt, rest, fps=FPS, options=each), spoken[::6]) for each in tried]
    best = tried[int(np.argmin(errors))]
    plain = untrained(spoken, rest, fps=FPS, options=best)
    settings = [replace(best, smoothness=smoothness) for smoothness in TRAINED_SMOOTHNESS]
    errors = [_error(fit_trajectory(learnt, rest, fps=FPS, options=each), spoken[::6]) for each in settings]
    trained = fit_trajectory(spoken, rest, fps=FPS, options=settings[int(np.argmin(errors))])
    return {PLAIN: plain.predict, TRAINED: trained.predict}


def _error(model: GaussianTrajectory, held: Sequence[Spoken]) -> float:
    """Weighted error of a model on sentences."""
    return trajectory_scores(
        predicted_by(model, held), [each.coefficients for each in held], model.scale
    ).error_weighted


def _coefficients(takes: Sequence[Take], folder: Path) -> tuple[list[Spoken], np.ndarray]:
    learnt = learn(takes, Workspace(folder / "again"))
    rest = learnt.appearance.rest
    return spoken_passages(learnt.corpus, learnt.appearance.coefficients, rest), rest


def _figures(report: Report, measured: Measured) -> None:
    scores = measured.tests[0].scores
    rows = {row.model: row.scores for row in scores.trajectories if row.space == LEADING}
    shipped = next(row for name, row in rows.items() if "avatar" in name)
    plain, trained = rows[PLAIN], rows[TRAINED]
    for bar in scores.bars():
        limit = f">= {bar.least}" if bar.least is not None and bar.most is None else ""
        limit = limit or (f"<= {bar.most}" if bar.most is not None else "")
        report.add(bar.figure, float("nan") if bar.value is None else bar.value, "", limit)
    for name, row in ((PLAIN, plain), (TRAINED, trained), ("the avatar's", shipped)):
        report.add(f"AMSE, weighted: {name}", row.error_weighted, "", "<= 0.48" if row is shipped else "")
        report.add(f"ACC, weighted: {name}", row.correlation_weighted, "", ">= 0.7" if row is shipped else "")
    lower = 100 * (1 - trained.error_weighted / plain.error_weighted)
    report.add("gradient training lowers AMSE by", lower, "%", ">= 12")
    report.add("and raises ACC by", trained.correlation_weighted - plain.correlation_weighted, "", ">= 0.05")
    if scores.closure is not None:
        report.add("lips closed at /m b p/", 100 * scores.closure.shown, "%", note=f"of {scores.closure.phones}")
