"""Trajectory models and renderers side by side, as tables to read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.table import Table

from app.engine.evaluation.comparison import ANALYSED, REST, Comparison
from app.engine.evaluation.training_sizes import SizePoint
from app.evaluation.plain_table import plain_table

NAMES = {REST: "mouth at rest", ANALYSED: "analysed (ceiling)"}


NAME_WIDTH = 18
"""Characters: these tables fit into 80 columns."""


def comparison_tables(found: Comparison) -> Iterator[Table]:
    """The tables of one test: trajectories as in table 1 of Deena 2010, pictures, and table I of Wang 2010."""
    yield _trajectories(found)
    yield _lips(found)
    if any(row.rendered for row in found.rows):
        yield _pictures(found)
        yield _squares(found)


def _table(found: Comparison, what: str, *columns: str) -> Table:
    return plain_table("", *columns, title=f"{found.test} test: {what}", names=NAME_WIDTH)


def _trajectories(found: Comparison) -> Table:
    table = _table(found, "trajectories in the common space", "AMSE", "ACC", "AMSEw", "ACCw", "ms")
    for row in found.rows:
        its = row.scores.trajectory
        figures = (
            (its.error, its.error_deviation), (its.correlation, its.correlation_deviation),
            (its.error_weighted, its.error_weighted_deviation),
            (its.correlation_weighted, its.correlation_weighted_deviation),
        )  # fmt: skip
        table.add_row(
            NAMES.get(row.model, row.model), *(f"{mean:.3f}±{spread:.3f}" for mean, spread in figures),
            f"{row.scores.milliseconds:.3f}" if row.model not in NAMES else "",
        )  # fmt: skip
    return table


def _lips(found: Comparison) -> Table:
    table = _table(found, "motion", "ampl.", "jerk", "opening r", "its lag", "its ampl.", "open at m b p")
    for row in found.rows:
        its, opening = row.scores.trajectory, row.scores.opening
        of_opening = (f"{opening.correlation:.3f}", f"{opening.lag}", f"{opening.amplitude:.2f}") if opening else "---"
        missed = f"{row.scores.unclosed:.0%} of {row.scores.closings}" if row.scores.closings else "-"
        table.add_row(
            NAMES.get(row.model, row.model), f"{its.amplitude:.2f}", f"{its.jerk:.2f}", *of_opening, missed
        )  # fmt: skip
    return table


def _pictures(found: Comparison) -> Table:
    table = _table(found, f"pictures of {found.pictured} sentences", "PSNR", "p10", "SSIM", "sharp", "jumps", "ms")
    for row in found.rows:
        for its in row.rendered:
            said = its.pictures
            figures = (f"{said.psnr:.2f}", f"{said.psnr_p10:.2f}", f"{said.ssim:.4f}") if said else "---"
            table.add_row(
                f"{NAMES.get(row.model, row.model)}, {its.renderer}", *figures, f"{its.sharpness:.2f}",
                f"{its.jumps:.2f}", f"{its.milliseconds:.2f}",
            )  # fmt: skip
    return table


def _squares(found: Comparison) -> Table:
    """The selection's own error is that of the row for analysed coefficients."""
    names = [its.renderer for its in found.rows[0].rendered]
    table = _table(found, "squared distances, in thousands", "trajectory", *(f"with {name}" for name in names))
    for row in found.rows:
        drawn = (f"{its.squares / 1000:.1f}" for its in row.rendered)
        table.add_row(NAMES.get(row.model, row.model), f"{row.scores.squares / 1000:.1f}", *drawn)
    return table


def sizes_table(points: Sequence[SizePoint]) -> Table:
    """The training-size curve, Figure 9 of Wang 2010."""
    table = plain_table(
        "", "sentences", "minutes", "squared", "AMSE", "ACC", "AMSEw", "ACCw", names=NAME_WIDTH,
        title="open test of models trained on parts of the recording",
    )  # fmt: skip
    for point in points:
        figures: tuple[str, ...] = ("too few", "", "", "", "")
        if point.scores is not None:
            its = point.scores.trajectory
            figures = (
                f"{point.scores.squares / 1000:.1f}", f"{its.error:.3f}", f"{its.correlation:.3f}",
                f"{its.error_weighted:.3f}", f"{its.correlation_weighted:.3f}",
            )  # fmt: skip
        table.add_row(point.model, f"{point.sentences}", f"{point.minutes:.1f}", *figures)
    return table
