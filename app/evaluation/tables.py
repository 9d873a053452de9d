"""An evaluation as tables to read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from rich.table import Table
from rich.text import Text

from app.align.agreement import Starts
from app.engine.evaluation.reconstruction import RENDERERS
from app.engine.evaluation.scores import Bar, Scores
from app.engine.metrics import PictureScores
from app.evaluation.comparison_tables import comparison_tables, sizes_table
from app.evaluation.evaluation import Evaluation
from app.evaluation.plain_table import plain_table

NAMES = {
    "avatar": "the avatar", "rest": "mouth at rest", "mean": "mean mouth", "predicted": "the avatar's mouth",
    "neutral": "mouth at rest (baseline)", "analysed": "analysed mouth (ceiling)", "serving": "serving modes",
    "literal": "literal model (eq. 3.3-3.5)", "fast": "its fast form",
}  # fmt: skip
MOST_REFUSED = 12
"""Refusals that are listed one by one."""


def tables(found: Evaluation) -> Iterator[Table | Text]:
    """What to print, in order."""
    for each in found.measured.tests:
        scores = each.scores
        yield Text(
            f"{found.avatar}, {scores.test} test: {scores.clips} clips, {scores.sentences} sentences, "
            f"{scores.frames} frames, {scores.speech_frames} of them speech",
            style="bold",
        )
        yield _trajectories(scores)
        yield _pictures(scores)
        yield _mouth(scores)
        if scores.gains:
            yield _gains(scores)
        yield _bars(scores.bars())
        for comparison in found.measured.comparisons:
            if comparison.test == scores.test:
                yield from comparison_tables(comparison)
    if found.measured.sizes:
        yield sizes_table(found.measured.sizes)
    if found.words:
        yield _words(found)
    if found.refused:
        yield from _refused(found)
    for note in found.notes:
        yield Text(note, style="italic")


def _trajectories(scores: Scores) -> Table:
    table = plain_table(
        "trajectories (w: weighted)", "AMSE", "ACC", "AMSEw", "ACCw", "ampl.", "jerk"
    )  # fmt: skip
    for row in scores.trajectories:
        its = row.scores
        table.add_row(
            f"{NAMES.get(row.model, row.model)}, {row.space}", f"{its.error:.3f} ± {its.error_deviation:.3f}",
            f"{its.correlation:.3f} ± {its.correlation_deviation:.3f}", f"{its.error_weighted:.3f}",
            f"{its.correlation_weighted:.3f}", f"{its.amplitude:.2f}", f"{its.jerk:.2f}",
        )  # fmt: skip
    return table


def _pictures(scores: Scores) -> Table:
    table = plain_table("pictures, mouth box, luma", "PSNR", "worst 10 % from", "SSIM", "frames")
    again = scores.reconstruction
    for where, drawn in (("speech", again.speech), ("all", again.all)):
        for name in RENDERERS:
            _add(table, f"analysed frames, {where}: {NAMES[name]}", drawn[name])
    _add(table, "fast form against literal", again.fast_against_literal)
    for name, found in scores.speech.items():
        _add(table, f"said again, speech: {NAMES[name]}", found)
    return table


def _add(table: Table, name: str, found: PictureScores | None) -> None:
    if found is None:
        table.add_row(name, "-", "-", "-", "0")
    else:
        table.add_row(name, f"{found.psnr:.2f} dB", f"{found.psnr_p10:.2f}", f"{found.ssim:.4f}", f"{found.pictures}")


def _mouth(scores: Scores) -> Table:
    table = plain_table("mouth and head", "")
    if scores.opening:
        its = scores.opening
        table.add_row("opening: correlation", f"{its.correlation:.3f}")
        table.add_row("opening: lag, frames", f"{its.lag}")
        table.add_row("opening: amplitude", f"{its.amplitude:.2f}")
    if scores.closure:
        shut = scores.closure
        table.add_row("lips closed at /m b p/, recorded", f"{shut.recorded:.0%} of {shut.phones}")
        table.add_row("lips closed at /m b p/, said again", f"{shut.shown:.0%}")
    table.add_row("motion of the nose, 95 %, px", f"{scores.nose.p95:.2f}")
    return table


def _gains(scores: Scores) -> Table:
    table = plain_table("motion from rest times", "amplitude", "AMSE weighted", "PSNR", "lips closed")
    for its in scores.gains:
        table.add_row(
            f"{its.gain:g}", "-" if its.amplitude is None else f"{its.amplitude:.2f}", f"{its.error_weighted:.3f}",
            f"{its.psnr:.2f} dB", "-" if its.closure is None else f"{its.closure:.0%}",
        )  # fmt: skip
    return table


def _bars(bars: tuple[Bar, ...]) -> Table:
    table = plain_table("bars", "measured", "wanted", "")
    for bar in bars:
        limits = [f"at least {bar.least:g}"] if bar.least is not None else []
        limits += [f"at most {bar.most:g}"] if bar.most is not None else []
        verdict = Text("met", style="green") if bar.met else Text("missed", style="red")
        if bar.value is None:
            verdict = Text("not measured", style="yellow")
        table.add_row(bar.figure, "-" if bar.value is None else f"{bar.value:.3f}", ", ".join(limits), verdict)
    return table


def _words(found: Evaluation) -> Table:
    assert found.words is not None
    table = plain_table(
        "starts of words against the corpus's own", "median, ms", "90 %, ms", "bias, ms", "over 40 ms", "words"
    )
    rows: tuple[tuple[str, Starts | None], ...] = (
        ("inside clips", found.words.inner), ("first words", found.words.onsets),
    )  # fmt: skip
    for name, its in rows:
        if its is not None:
            table.add_row(
                name, f"{its.median:.0f}", f"{its.p90:.0f}", f"{its.bias:+.0f}", f"{its.over_40:.0%}", f"{its.count}"
            )
    return table


def _refused(found: Evaluation) -> Iterator[Table]:
    clips = [each for each in found.refused if each.frame is None]
    if clips:
        table = plain_table("clips not used", "why")
        for each in clips[:MOST_REFUSED]:
            table.add_row(each.take, each.reason)
        if len(clips) > MOST_REFUSED:
            table.add_row(f"and {len(clips) - MOST_REFUSED} more", "")
        yield table
    frames = Counter(each.reason for each in found.refused if each.frame is not None)
    if frames:
        table = plain_table("pictures not used", "how many")
        for reason, count in frames.most_common():
            table.add_row(reason, f"{count}")
        yield table
