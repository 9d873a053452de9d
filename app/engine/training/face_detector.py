"""Where the face is in a picture: a boosted cascade of local binary patterns, without a download.

The cascade is OpenCV's own, as scikit-image's wheel carries it: OpenCV 5's wheel has the code but no cascades.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.data import lbp_frontal_face_cascade_filename

SMALLEST = 0.14
"""Of the picture's shorter side: smaller faces are not looked for."""
RIVAL = 0.5
"""Of the largest face's side: a second face this large makes it unclear whose mouth is meant."""


@dataclass(frozen=True, slots=True)
class FaceBox:
    """A square around a face, pixels."""

    x: float
    y: float
    side: float


@cache
def _cascade() -> cv2.CascadeClassifier:
    # The file is spelled for OpenCV 1; nothing reads "featuhreParams" any more.
    path = Path(lbp_frontal_face_cascade_filename())  # type: ignore[no-untyped-call]
    text = path.read_text().replace("featuhreParams", "featureParams")
    storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    classifier = cv2.CascadeClassifier()
    if not classifier.read(storage.getFirstTopLevelNode()):
        raise RuntimeError("the face cascade of this scikit-image cannot be read")
    return classifier


def find_faces(luma: NDArray[np.uint8]) -> list[FaceBox]:
    """Faces in a picture (H, W), the largest first; those much smaller than the largest are left out."""
    scale = min(1.0, 360 / min(luma.shape))
    small = luma if scale == 1 else cv2.resize(luma, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    least = round(SMALLEST * min(small.shape))
    found = _cascade().detectMultiScale(np.ascontiguousarray(small), 1.1, 4, minSize=(least, least))
    squares = np.asarray(found, np.float64).reshape(-1, 4)[:, :3] / scale
    boxes = sorted((FaceBox(*square) for square in squares.tolist()), key=lambda box: -box.side)
    return [box for box in boxes if box.side >= RIVAL * boxes[0].side]
