"""Trajectories: Fu 2011's table 4.3 with all coefficients, dense against banded."""

from __future__ import annotations

import numpy as np

from app.engine.avatar import load_avatar
from app.engine.trajectory import GaussianTrajectory
from app.speech import Phone
from bench.engine import seconds
from bench.recorded import FOLDER, recording
from bench.report import Report

THESIS = {262: (0.564, 0.114), 431: (1.273, 0.322), 856: (8.614, 1.245), 1302: (29.633, 2.860)}
"""Frames: seconds of the old and of the new computation of table 4.3."""


def run() -> list[Report]:
    """Time by length; equality with a dense solve."""
    report = Report("trajectory", "Trajectories of all coefficients (Fu 2011, table 4.3)")
    model = load_avatar(FOLDER).pack.trajectory
    phones = recording().phones
    taken = {}
    for frames, (old, new) in THESIS.items():
        spoken = repeated(phones, frames / model.fps)
        taken[frames] = seconds(lambda spoken=spoken, frames=frames: model.predict(spoken, frames))
        bar = "<= 30" if frames == 1302 else ""
        report.add(f"{frames} frames", taken[frames] * 1e3, "ms", bar, f"Fu 2011: {old} s before, {new} s after")
    report.add("growth from 262 to 1302 frames", (taken[1302] / taken[262]) / (1302 / 262), "of linear", "<= 1.3")
    frames = 1302
    spoken = repeated(phones, frames / model.fps)
    diagonal, right = model.targets(model.occupancy(spoken, frames))
    banded = model.smooth(diagonal, right)
    report.add(
        "largest difference to a dense solve",
        np.abs(banded - dense(model, diagonal, right)).max(),
        "standard deviations",
        "<= 1e-6",
    )
    once = seconds(lambda: dense(model, diagonal[:, :1], right[:, :1]), 1)
    report.add("dense solve, one coefficient of 1302 frames", once * 1e3, "ms", note="baseline; times K for all")
    return [report]


def repeated(phones: tuple[Phone, ...], length: float) -> tuple[Phone, ...]:
    """The recording's phones over and over until `length` seconds are filled."""
    result: list[Phone] = []
    start = 0.0
    while start < length:
        result += [Phone(phone.symbol, phone.start + start, phone.end + start) for phone in phones]
        start = result[-1].end
    return tuple(result)


def dense(model: GaussianTrajectory, diagonal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Eq. 3.2 with T x T matrices, as Fu 2011 prints it."""
    frames = len(right)
    first = np.diff(np.eye(frames), axis=0)
    smooth = model.smoothness * np.linalg.matrix_power(first.T @ first, model.order)
    columns = [np.linalg.solve(np.diag(d) + smooth, r) for d, r in zip(diagonal.T, right.T, strict=True)]
    return np.stack(columns, 1)
