"""How good an animation is, as numbers: of trajectories, of pictures, and of the opening of the mouth.

Trajectories are scored as Deena 2010 does in table 1 (average mean squared error and average correlation coefficient of
the parameters, mean and deviation over sentences), in standard deviations of the training data, and also with each
parameter weighted by its variance: then a parameter counts by what it shows. Any model's trajectories can be scored,
and any pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

Array = NDArray[np.float64]
Float = NDArray[np.float32]
Window = tuple[slice, slice]

_structural_similarity: Any = structural_similarity  # its package has no types

PEAK = 255.0
"""Of peak signal-to-noise ratios; luma as it is stored (limited range)."""
ROUNDING = 1e-5
"""Of a trajectory's largest value: what moves by less only looks like moving, in single precision."""
NO_ERROR = 1e-3
"""Mean squared error below which a picture counts as equal: 78 dB."""


@dataclass(frozen=True, slots=True)
class TrajectoryScores:
    """Predicted against true parameters.

    Attributes:
        error, error_deviation: AMSE: mean over sentences, and standard deviation over them, of the mean squared error
            of all parameters in standard deviations of the training data.
        correlation, correlation_deviation: ACC: mean over sentences, and standard deviation over them, of the mean
            correlation coefficient of all parameters.
        error_weighted, correlation_weighted: the same means, parameters weighted by their variance.
        error_weighted_deviation, correlation_weighted_deviation: and their deviations over sentences.
        amplitude: deviation of the predicted parameters over that of the true ones, weighted alike.
        jerk: root mean square third difference of the predicted over that of the true parameters, weighted alike.
        sentences, frames: how many.
    """

    error: float
    error_deviation: float
    correlation: float
    correlation_deviation: float
    error_weighted: float
    error_weighted_deviation: float
    correlation_weighted: float
    correlation_weighted_deviation: float
    amplitude: float
    jerk: float
    sentences: int
    frames: int


LEAST_FRAMES = 4
"""Shorter sentences have no third difference and are not scored."""


def trajectory_scores(
    predicted: Sequence[NDArray[Any]], true: Sequence[NDArray[Any]], scale: NDArray[Any]
) -> TrajectoryScores:
    """Score trajectories (Deena 2010, table 1).

    Args:
        predicted, true: (T, K) of each sentence; those of fewer than `LEAST_FRAMES` are left out.
        scale: (K,) standard deviation of each parameter in the training data.

    Raises:
        ValueError: shapes differ, or no sentence is long enough.
    """
    variance = np.square(scale, dtype=np.float64)
    weight = variance / variance.sum()
    errors, correlations, spreads, jerks = [], [], [], []
    frames = 0
    for shown, wanted in zip(predicted, true, strict=True):
        if shown.shape != wanted.shape or shown.shape[1:] != scale.shape:
            raise ValueError(f"trajectories of shapes {shown.shape} and {wanted.shape} with {scale.shape} deviations")
        if len(shown) < LEAST_FRAMES:
            continue
        a, b = (np.asarray(each, np.float64) / scale for each in (shown, wanted))
        errors.append(((a - b) ** 2).mean(0))
        correlations.append(correlation(a, b))
        spreads.append((a.std(0), b.std(0)))
        jerks.append([(np.diff(each, 3, axis=0) ** 2 @ weight).mean() for each in (a, b)])
        frames += len(a)
    if not errors:
        raise ValueError("no sentence is long enough to be scored")
    error, related = np.array(errors), np.array(correlations)
    spread = np.array(spreads).mean(0) @ weight
    jerk = np.sqrt(np.array(jerks).mean(0))
    return TrajectoryScores(
        error=float(error.mean()),
        error_deviation=float(error.mean(1).std()),
        correlation=float(related.mean()),
        correlation_deviation=float(related.mean(1).std()),
        error_weighted=float(error.mean(0) @ weight),
        error_weighted_deviation=float((error @ weight).std()),
        correlation_weighted=float(related.mean(0) @ weight),
        correlation_weighted_deviation=float((related @ weight).std()),
        amplitude=float(spread[0] / max(spread[1], 1e-12)),
        jerk=float(jerk[0] / max(jerk[1], 1e-12)),
        sentences=len(errors),
        frames=frames,
    )


def correlation(a: Array, b: Array) -> Array:
    """(K,) correlation over time of two (T, K) trajectories; 0 where one of them does not move."""
    still = [each.std(0) <= ROUNDING * np.abs(each).max(0, initial=0) for each in (a, b)]
    a, b = a - a.mean(0), b - b.mean(0)
    product = np.sqrt((a**2).sum(0) * (b**2).sum(0))
    moving = ~(still[0] | still[1]) & (product > 1e-12)
    return cast(Array, np.where(moving, (a * b).sum(0) / np.maximum(product, 1e-12), 0.0))


def psnr(shown: NDArray[Any], wanted: NDArray[Any], window: Window) -> Array:
    """(n,) peak signal-to-noise ratio of luma pictures (n, h, w) in a window, dB."""
    difference = shown[:, window[0], window[1]].astype(np.float64) - wanted[:, window[0], window[1]]
    error = (difference**2).reshape(len(shown), -1).mean(1)
    return cast(Array, 10 * np.log10(PEAK**2 / np.maximum(error, NO_ERROR)))


def ssim(shown: NDArray[Any], wanted: NDArray[Any], window: Window) -> Array:
    """(n,) structural similarity of luma pictures (n, h, w) in a window (Gaussian weights of 1.5 pixels)."""
    options: dict[str, Any] = {
        "data_range": PEAK, "gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False,
    }  # fmt: skip
    return np.array(
        [
            _structural_similarity(a[window].astype(np.float64), b[window].astype(np.float64), **options)
            for a, b in zip(shown, wanted, strict=True)
        ]
    )


def gradient_energy(pictures: NDArray[Any], window: Window) -> float:
    """Mean squared gradient in a window of luma pictures (n, h, w): how much detail there is."""
    inner = pictures[:, window[0], window[1]].astype(np.float64)
    return float((np.diff(inner, axis=1)[:, :, :-1] ** 2 + np.diff(inner, axis=2)[:, :-1] ** 2).mean())


@dataclass(frozen=True, slots=True)
class PictureScores:
    """Pictures against those they should be.

    Attributes:
        psnr, psnr_p10: mean and 10th percentile over pictures, dB.
        ssim: mean structural similarity.
        pictures: how many.
    """

    psnr: float
    psnr_p10: float
    ssim: float
    pictures: int


def picture_scores(ratios: NDArray[Any], similarities: NDArray[Any]) -> PictureScores | None:
    """Sum up what `psnr` and `ssim` give for each picture; None if there are none."""
    if not len(ratios):
        return None
    return PictureScores(
        float(np.mean(ratios)), float(np.percentile(ratios, 10)), float(np.mean(similarities)), len(ratios)
    )


@dataclass(frozen=True, slots=True)
class OpeningScores:
    """The opening of the mouth, shown against true.

    Attributes:
        correlation: over all frames, at the best lag.
        lag: frames by which the shown mouth is behind the true one, where they correlate best.
        amplitude: standard deviation of the shown opening over that of the true one.
    """

    correlation: float
    lag: int
    amplitude: float


MOST_LAG = 6
"""Frames that are tried to both sides."""


def opening_scores(shown: Sequence[NDArray[Any]], true: Sequence[NDArray[Any]]) -> OpeningScores | None:
    """Compare openings (T,) of sentences, each without its mean; None if none is longer than the lags tried."""
    pairs = [
        (np.asarray(a, np.float64) - np.mean(a), np.asarray(b, np.float64) - np.mean(b))
        for a, b in zip(shown, true, strict=True)
        if len(a) > 2 * MOST_LAG
    ]
    if not pairs:
        return None
    best, lag = 0.0, 0
    for tried in sorted(range(-MOST_LAG, MOST_LAG + 1), key=abs):  # of equals the smallest
        found = _related([_overlapping(a, b, tried) for a, b in pairs])
        if found > best + 1e-9:
            best, lag = found, tried
    spread = [np.sqrt(np.mean([np.var(pair[side]) for pair in pairs])) for side in (0, 1)]
    return OpeningScores(best, lag, float(spread[0] / max(spread[1], 1e-12)))


def _overlapping(a: Array, b: Array, lag: int) -> tuple[Array, Array]:
    """What there is of both when the first is `lag` frames late."""
    return (a[lag:], b[: len(b) - lag]) if lag >= 0 else (a[:lag], b[-lag:])


def _related(pairs: Sequence[tuple[Array, Array]]) -> float:
    product = sum(float(a @ b) for a, b in pairs)
    both = sum(float(a @ a) for a, _ in pairs) * sum(float(b @ b) for _, b in pairs)
    return product / float(np.sqrt(both)) if both > 1e-24 else 0.0
