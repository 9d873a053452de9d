"""Figures on disk, as SVG; the same figures give the same bytes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def new_figure(rows: int, *, height: float = 1.6, shared: bool = True) -> tuple[Figure, list[Axes]]:
    """A figure of some axes below each other.

    Args:
        rows: how many.
        height: of each, inches.
        shared: they have one horizontal axis.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 1.2 + height * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=shared, squeeze=False)
    return figure, [axis for row in axes for axis in row]


def save_plot(figure: Figure, path: Path) -> str:
    """Write a figure; the file's name."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    options: Any = {"svg.hashsalt": "mary", "svg.fonttype": "none", "font.family": "sans-serif"}
    canvas: Any = FigureCanvasSVG(figure)
    with matplotlib.rc_context(options):
        canvas.print_svg(str(path), metadata={"Date": None, "Creator": None})
    return path.name
