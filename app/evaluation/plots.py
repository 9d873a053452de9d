"""Plots of an evaluation, as SVG; the same figures give the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.engine.evaluation.measure import Example, Measured, Test
from app.engine.evaluation.speech import SHOWN
from app.engine.pack import FPS
from app.evaluation.comparison_plots import write_comparison_plots
from app.evaluation.save_plot import new_figure, save_plot
from app.speech import SILENCE, Phone

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SENTENCES = 3
"""Plotted of each test, evenly spread."""
COMPONENTS = 3
"""Trajectories of a sentence: the ones that move most in training."""
RECORDED, SAID = "#202020", "#d1495b"
COLOURS = {"predicted": SAID, "neutral": "#8d99ae", "analysed": "#2a9d8f"}
LABELS = {"predicted": "said by the avatar", "neutral": "mouth at rest", "analysed": "analysed frames, drawn again"}


def write_plots(measured: Measured, folder: Path) -> list[str]:
    """Write all plots of an evaluation into a folder; their names."""
    written = []
    for test in measured.tests:
        name = test.scores.test
        for number, example in enumerate(_chosen(test.examples), 1):
            figure = _trajectories(example, measured.scale, measured.flow_count)
            written.append(save_plot(figure, folder / f"{name}-trajectories-{number}.svg"))
            written.append(save_plot(_opening(example), folder / f"{name}-opening-{number}.svg"))
        written.append(save_plot(_distribution(test), folder / f"{name}-psnr.svg"))
    return written + write_comparison_plots(measured, folder)


def _chosen(examples: Sequence[Example]) -> list[Example]:
    places = np.linspace(0, len(examples) - 1, min(SENTENCES, len(examples))).round().astype(int)
    return [examples[place] for place in np.unique(places)]


def _trajectories(example: Example, scale: NDArray[np.float64], flow_count: int) -> Figure:
    sentence = example.sentence
    chosen = np.argsort(-scale[:flow_count], kind="stable")[:COMPONENTS]
    figure, axes = new_figure(len(chosen))
    times = np.arange(len(sentence.numbers)) / FPS
    for axis, component in zip(axes, chosen, strict=True):
        true = np.where(sentence.counted, sentence.true[:, component], np.nan)
        axis.plot(times, true, color=RECORDED, label="recorded")
        axis.plot(times, sentence.predicted[:, component], color=SAID, label="said by the avatar")
        axis.set_ylabel(f"flow mode {component + 1}")
    _label(axes, sentence.phones, times)
    figure.suptitle(sentence.name)
    return figure


def _opening(example: Example) -> Figure:
    figure, axes = new_figure(1)
    times = np.arange(len(example.sentence.numbers)) / FPS
    axes[0].plot(times, example.drawn.recorded, color=RECORDED, label="recorded")
    axes[0].plot(times, example.drawn.shown, color=SAID, label="said by the avatar")
    axes[0].set_ylabel("opening of the mouth")
    _label(axes, example.sentence.phones, times)
    figure.suptitle(example.sentence.name)
    return figure


def _label(axes: Sequence[Axes], phones: Sequence[Phone], times: NDArray[np.float64]) -> None:
    """Phones above the first axes, their limits in all, and what all axes share."""
    for phone in phones:
        for axis in axes:
            axis.axvline(phone.start, color="#d0d0d0", linewidth=0.6, zorder=0)
        if phone.symbol != SILENCE:
            axes[0].text(
                (phone.start + phone.end) / 2, 1.02, phone.symbol, transform=_above(axes[0]), ha="center", va="bottom",
                fontsize=7,
            )  # fmt: skip
    axes[-1].set_xlabel("seconds")
    axes[-1].set_xlim(float(times[0]), float(times[-1]) if len(times) > 1 else 1.0)
    axes[-1].legend(loc="upper right", fontsize=8)


def _above(axis: Axes) -> Any:
    """Seconds across, share of the axes' height up."""
    transform: Callable[[], Any] = axis.get_xaxis_transform
    return transform()


def _distribution(test: Test) -> Figure:
    figure, axes = new_figure(1)
    for place, name in enumerate(SHOWN):
        values = np.concatenate(list(_ratios(test, place)))
        bins = np.arange(np.floor(values.min()), np.ceil(values.max()) + 0.5, 0.5)
        axes[0].hist(values, bins=list(bins), histtype="step", color=COLOURS[name], label=LABELS[name])
    axes[0].set_xlabel("PSNR of the mouth in speech, dB")
    axes[0].set_ylabel("frames")
    axes[0].legend(loc="upper right", fontsize=8)
    figure.suptitle(f"{test.scores.test} test")
    return figure


def _ratios(test: Test, place: int) -> Iterator[NDArray[np.float64]]:
    for example in test.examples:
        yield example.drawn.scores[example.sentence.speech, place, 0]
