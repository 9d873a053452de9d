"""Scaled conjugate gradients (Moller 1993): how Deena 2010 optimises, in training and in synthesis."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Objective = Callable[[Array], tuple[float, Array]]

PROBE = 1e-4
"""Length of the step by which the curvature is felt, sigma in the paper."""
LEAST_SCALE, MOST_SCALE = 1e-15, 1e20


def minimise(objective: Objective, start: Array, *, steps: int, enough: float = 1e-6) -> tuple[Array, float]:
    """Go downhill from a point; no line searches, two gradients a step.

    Args:
        objective: value and gradient (n,) at a point; LinAlgError where there is none: counts as uphill.
        start: (n,).
        steps: at most.
        enough: ends when a step moves no coordinate by more and lowers the value by no more.

    Returns:
        The lowest point found, and its value.
    """
    point = start.astype(np.float64)
    value, gradient = objective(point)
    direction = -gradient
    scale, curvature, succeeded, fruitful = 1.0, 0.0, True, 0
    slope = squared = 0.0
    for _ in range(steps):
        if succeeded:
            slope = float(direction @ gradient)
            if slope >= 0:
                direction = -gradient
                slope = float(direction @ gradient)
            squared = float(direction @ direction)
            if squared < 1e-24:
                break
            probe = PROBE / np.sqrt(squared)
            try:
                ahead = objective(point + probe * direction)[1]
                curvature = float(direction @ (ahead - gradient)) / probe
            except np.linalg.LinAlgError:
                curvature = 0.0
        damped = curvature + scale * squared
        if damped <= 0:
            damped = scale * squared
            scale -= curvature / squared
        length = -slope / damped
        candidate = point + length * direction
        try:
            lower, downhill = objective(candidate)
        except np.linalg.LinAlgError:
            lower, downhill = np.inf, gradient
        agreement = 2.0 * (lower - value) / (length * slope)
        succeeded = bool(agreement >= 0)
        if succeeded:
            gained, before = value - lower, gradient
            point, value, gradient = candidate, lower, downhill
            fruitful += 1
            if np.abs(length * direction).max() <= enough and gained <= enough:
                break
            if fruitful == len(point):
                direction, fruitful, scale = -gradient, 0, 1.0
            else:
                turn = float((before - gradient) @ gradient) / slope
                direction = turn * direction - gradient
        if not agreement >= 0.25:
            scale = min(4.0 * scale, MOST_SCALE)
        elif agreement > 0.75:
            scale = max(0.5 * scale, LEAST_SCALE)
        if scale >= MOST_SCALE:
            break
    return point, value
