"""Plots, as PNG. They are drawn on figures of their own: nothing of pyplot, which a caller may be using, is touched."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from app.engine.pack import FPS
from app.speech import SILENCE, Phone

Float = NDArray[np.float32]
Array = NDArray[np.float64]

DOTS = 110
"""Pixels an inch."""
REAL, PREDICTED = "#444444", "#d1495b"
ONE, OTHER = "#8d99ae", "#1f7a8c"


def histograms(values: Sequence[tuple[str, NDArray[Any]]], unit: str, *, most: float) -> bytes:
    """Distributions over each other.

    Args:
        values: names and numbers (n,).
        unit: of the numbers.
        most: upper end of the axis; what is above is counted there.
    """
    figure, axes = _figure(7.2, 2.2, 1)
    edges = np.linspace(0, most, 49)
    for (name, numbers), colour in zip(values, (ONE, OTHER), strict=False):
        axes[0].hist(np.clip(numbers, 0, most), edges, label=name, color=colour, alpha=0.75)
    axes[0].set_xlabel(unit)
    axes[0].set_ylabel("pictures")
    axes[0].set_xlim(0, most)
    if len(values) > 1:
        axes[0].legend(frameon=False)
    return _png(figure)


def trajectories(rows: Sequence[tuple[str, Float, Float]], phones: Sequence[Phone]) -> bytes:
    """Real and predicted coefficients of a sentence under its phones.

    Args:
        rows: name, real (T,), predicted (T,); in standard deviations.
        phones: times from the first frame.
    """
    figure, axes = _figure(11, 0.5 + 1.15 * len(rows), len(rows))
    length = len(rows[0][1])
    times = np.arange(length) / FPS
    for axis, (name, real, predicted) in zip(axes, rows, strict=True):
        axis.plot(times, real, color=REAL, linewidth=1.3, label="real")
        axis.plot(times, predicted, color=PREDICTED, linewidth=1.3, label="synthesised")
        axis.set_ylabel(name)
        axis.set_xlim(0, max(times[-1], 1 / FPS))
        for phone in phones:
            axis.axvline(phone.start, color="#dddddd", linewidth=0.7, zorder=0)
    for phone in phones:
        middle = (max(phone.start, 0) + min(phone.end, times[-1])) / 2
        label = "" if phone.symbol == SILENCE else phone.symbol
        axes[0].text(
            middle, 1.03, label, transform=axes[0].get_xaxis_transform(), ha="center", va="bottom", fontsize=7
        )  # fmt: skip
    axes[-1].set_xlabel("seconds")
    axes[-1].legend(frameon=False, ncols=2, fontsize=8, loc="lower right")
    return _png(figure)


def loop_steps(differences: Array, seams: Sequence[int]) -> bytes:
    """How much each picture of a loop differs from the one before.

    Args:
        differences: (L,).
        seams: places of the first pictures after a dissolve.
    """
    figure, axes = _figure(9, 2.0, 1)
    axes[0].plot(differences, color=OTHER, linewidth=1.2)
    for seam in seams:
        axes[0].axvline(seam, color=PREDICTED, linewidth=0.9, linestyle="--")
    axes[0].set_xlabel("picture of the loop" + (" (dashed: the end of a dissolve)" if seams else ""))
    axes[0].set_ylabel("mean difference")
    axes[0].set_xlim(0, max(1, len(differences)))
    axes[0].set_ylim(bottom=0)
    return _png(figure)


def _figure(width: float, height: float, rows: int) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=(width, height), dpi=DOTS, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for axis in axes:
        axis.tick_params(labelsize=8)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    return figure, list(axes)


def _png(figure: Figure) -> bytes:
    file = BytesIO()
    printed: Callable[..., None] = FigureCanvasAgg(figure).print_png
    printed(file, metadata={"Software": None})
    return file.getvalue()
