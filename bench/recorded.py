"""The default avatar's recording as the benchmarks compare it: luma of frames, phones, the boxes that are measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from app.engine.frame import Picture, planes, to_rgb
from app.engine.training.recording import Recording, read
from app.speech import SILENCE

FOLDER = Path(__file__).parent.parent / "avatars" / "mary"
ACTIVE = (slice(11, 139), slice(15, 157))
"""Rows and columns of the crops in which anything moves: all picture figures are of this box."""
INNER = (slice(60, 100), slice(60, 118))
"""The inside of the mouth."""

Float = NDArray[np.float32]


def recording() -> Recording:
    """The recording that ships."""
    return read(FOLDER)


def full_range(luma: NDArray[np.uint8] | Float) -> Float:
    """Limited-range luma on the 0 to 255 scale of peak signal-to-noise ratios."""
    scaled: Float = (luma.astype(np.float32) - 16) * np.float32(255 / 219)
    return scaled


def recorded_luma(source: Recording) -> Float:
    """(T, h, w) luma of the crops, 0 to 255."""
    width, height = source.crop.width, source.crop.height
    return full_range(source.frames[:, : width * height].reshape(-1, height, width))


def crop_luma(source: Recording, picture: Picture) -> Float:
    """Luma of the crop of a whole picture, 0 to 255."""
    crop = source.crop
    return full_range(planes(picture)[0][crop.y : crop.y + crop.height, crop.x : crop.x + crop.width])


def crop_rgb(source: Recording, picture: Picture) -> NDArray[np.uint8]:
    """RGB of the crop of a whole picture."""
    crop = source.crop
    return to_rgb(picture)[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width]


def speech_frames(source: Recording) -> NDArray[np.bool_]:
    """(T,) frames that show a phone other than silence."""
    speaking = np.zeros(len(source.frames), bool)
    for phone in source.phones:
        if phone.symbol != SILENCE:
            speaking[round(phone.start * source.fps) : round(phone.end * source.fps)] = True
    return speaking


def psnr(shown: Float, wanted: Float) -> Float:
    """(n,) peak signal-to-noise ratio of each frame in the active box, dB."""
    error = ((shown - wanted)[:, ACTIVE[0], ACTIVE[1]] ** 2).reshape(len(shown), -1).mean(1)
    ratio: Float = 10 * np.log10(255**2 / np.maximum(error, 1e-3))
    return ratio


def ssim(shown: Float, wanted: Float) -> float:
    """Mean structural similarity in the active box (Gaussian window of 1.5 pixels)."""
    options = {"data_range": 255, "gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    return float(
        np.mean([structural_similarity(a[ACTIVE], b[ACTIVE], **options) for a, b in zip(shown, wanted, strict=True)])
    )


def gradient_energy(frames: Float) -> float:
    """Mean squared gradient inside the mouth: how much detail there is."""
    inner = frames[:, INNER[0], INNER[1]]
    return float((np.diff(inner, axis=1)[:, :, :-1] ** 2 + np.diff(inner, axis=2)[:, :-1] ** 2).mean())
