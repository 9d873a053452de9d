"""Trajectory models and renderers side by side, as plots."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from app.engine.evaluation.comparison import Comparison
from app.engine.evaluation.measure import Measured
from app.engine.evaluation.training_sizes import SizePoint
from app.evaluation.comparison_tables import NAMES
from app.evaluation.save_plot import new_figure, save_plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BAR = "#457b9d"
SIZES = "training-sizes.svg"


def write_comparison_plots(measured: Measured, folder: Path) -> list[str]:
    """Write the plots into a folder; their names."""
    written = []
    for found in measured.comparisons:
        written.append(save_plot(_models(found), folder / f"{found.test}-models.svg"))
        if any(row.rendered for row in found.rows):
            written.append(save_plot(_renderers(found), folder / f"{found.test}-renderers.svg"))
    if any(point.scores for point in measured.sizes):
        written.append(save_plot(_sizes(measured.sizes), folder / SIZES))
    return written


def _models(found: Comparison) -> Figure:
    figure, axes = new_figure(2, height=0.7 + 0.3 * len(found.rows), shared=False)
    names = [NAMES.get(row.model, row.model) for row in found.rows]
    scores = [row.scores.trajectory for row in found.rows]
    shown = (
        ("AMSE, weighted by variance", [(its.error_weighted, its.error_weighted_deviation) for its in scores]),
        (
            "ACC, weighted by variance",
            [(its.correlation_weighted, its.correlation_weighted_deviation) for its in scores],
        ),
    )
    for axis, (label, values) in zip(axes, shown, strict=True):
        axis.barh(names, [mean for mean, _ in values], xerr=[spread for _, spread in values], color=BAR, capsize=3)
        axis.invert_yaxis()
        axis.set_xlabel(f"{label}; mean and deviation over {found.sentences} sentences")
    figure.suptitle(f"{found.test} test, common space")
    return figure


def _renderers(found: Comparison) -> Figure:
    rows = [(f"{NAMES.get(row.model, row.model)}, {its.renderer}", its) for row in found.rows for its in row.rendered]
    names = [name for name, _ in rows]
    figure, axes = new_figure(2, height=0.7 + 0.3 * len(rows), shared=False)
    axes[0].barh(names, [its.pictures.psnr if its.pictures else 0.0 for _, its in rows], color=BAR)
    axes[0].set_xlabel("PSNR of the mouth in speech, dB")
    axes[1].barh(names, [its.sharpness for _, its in rows], color=BAR)
    axes[1].set_xlabel("gradient energy over that of the recording")
    for axis in axes:
        axis.invert_yaxis()
    figure.suptitle(f"{found.test} test, pictures of {found.pictured} sentences")
    return figure


def _sizes(points: Sequence[SizePoint]) -> Figure:
    figure, axes = new_figure(1, height=3.0)
    for model in dict.fromkeys(point.model for point in points):
        line = [(point.minutes, point.scores.squares) for point in points if point.model == model and point.scores]
        axes[0].plot([minutes for minutes, _ in line], [squares for _, squares in line], marker="o", label=model)
    axes[0].set_xlabel("minutes of recording trained on")
    axes[0].set_ylabel("mean squared error")
    axes[0].legend(loc="upper right", fontsize=8)
    figure.suptitle("open test, trajectories in the common space")
    return figure
