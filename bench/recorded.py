"""The default avatar's recording as the benchmarks compare it: pictures, phones, the boxes that are measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from app.align.transcript import read_transcript
from app.engine.background import Box
from app.engine.frame import Picture, planes, to_rgb
from app.engine.pack import FPS
from app.engine.training.footage import shots
from app.engine.training.take import Take, passages
from app.speech import SILENCE, Phone

FOLDER = Path(__file__).parent.parent / "avatars" / "mary"
VIDEO = FOLDER / "recording" / "recording.mp4"
BOX = Box(168, 268, 176, 148)
"""The mouth in the recording's frames."""
ACTIVE = (slice(11, 139), slice(15, 157))
"""Rows and columns of the box in which anything moves: all picture figures are of these."""
INNER = (slice(60, 100), slice(60, 118))
"""The inside of the mouth."""

Float = NDArray[np.float32]


@dataclass(frozen=True)
class Recorded:
    """The recording.

    Attributes:
        phones: of all of it.
        luma: (T, h, w) of the box, 0 to 255.
        rgb: (T, h, w, 3) of the box.
        still: the first picture.
    """

    phones: tuple[Phone, ...]
    luma: Float
    rgb: NDArray[np.uint8]
    still: Picture

    @property
    def take(self) -> Take:
        """What training is given."""
        return Take("recording", VIDEO, self.phones)

    def spans(self) -> list[range]:
        """The frames of each sentence."""
        return passages(self.phones, len(self.luma))


@lru_cache(maxsize=1)
def recording() -> Recorded:
    """The recording that ships."""
    pictures = [shot.picture.copy() for shot in shots(VIDEO)]
    phones = read_transcript(VIDEO.with_suffix(".TextGrid")).alignment(len(pictures) / FPS).phones
    luma = np.stack([crop_luma(picture) for picture in pictures])
    return Recorded(phones, luma, np.stack([crop_rgb(picture) for picture in pictures]), pictures[0])


def full_range(luma: NDArray[np.uint8] | Float) -> Float:
    """Limited-range luma on the 0 to 255 scale of peak signal-to-noise ratios."""
    scaled: Float = (luma.astype(np.float32) - 16) * np.float32(255 / 219)
    return scaled


def crop_luma(picture: Picture) -> Float:
    """Luma of the box of a whole picture, 0 to 255."""
    return full_range(planes(picture)[0][BOX.y : BOX.y + BOX.height, BOX.x : BOX.x + BOX.width])


def crop_rgb(picture: Picture) -> NDArray[np.uint8]:
    """RGB of the box of a whole picture."""
    return to_rgb(picture)[BOX.y : BOX.y + BOX.height, BOX.x : BOX.x + BOX.width]


def in_box(still: Picture, crop: Box, luma: Float, mask: Float) -> Float:
    """(h, w) luma of the box, 0 to 255, of a mouth drawn in a model's own crop, on the still."""
    whole = planes(still)[0].astype(np.float32)
    place = whole[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width]
    place += mask * (luma - place)
    return full_range(whole[BOX.y : BOX.y + BOX.height, BOX.x : BOX.x + BOX.width])


def speech_frames(source: Recorded) -> NDArray[np.bool_]:
    """(T,) frames that show a phone other than silence."""
    speaking = np.zeros(len(source.luma), bool)
    for phone in source.phones:
        if phone.symbol != SILENCE:
            speaking[round(phone.start * FPS) : round(phone.end * FPS)] = True
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
