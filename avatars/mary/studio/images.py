"""Pictures as arrays: RGB, float32, 0..255."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float32]


def read_picture(path: Path) -> Picture:
    """(H, W, 3)."""
    found = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if found is None:
        raise FileNotFoundError(f"{path} is missing or no picture")
    return np.ascontiguousarray(found[..., ::-1]).astype(np.float32)


def write_picture(path: Path, picture: Picture) -> None:
    """Rounded to 8 bits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), to_bytes(picture)[..., ::-1])


def to_bytes(picture: Picture) -> NDArray[np.uint8]:
    """Rounded to 8 bits."""
    return cast(NDArray[np.uint8], np.clip(picture + 0.5, 0, 255).astype(np.uint8))


def blurred(image: NDArray[Any], sigma: float) -> Picture:
    """Gaussian, sigma in pixels."""
    return cast(Picture, cv2.GaussianBlur(image, (0, 0), sigma))
