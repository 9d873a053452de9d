"""Where points of the scene are in the picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera that takes square pictures.

    Attributes:
        view: (4, 4) from Blender's world (metres) to the camera, which looks along -z, y up.
        focal: focal length over the sensor's width.
    """

    view: Array
    focal: float

    def project(self, points: Array, size: int) -> tuple[Array, Array]:
        """Points of MakeHuman's frame (..., 3), dm, in a picture of `size` by `size` pixels.

        Returns:
            (..., 2) pixels, x to the right and y down, 0 at the upper left corner of the first pixel, so pixels have
            their centres at halves; and (...) metres from the camera.
        """
        world = np.stack([points[..., 0], -points[..., 2], points[..., 1]], -1) * 0.1
        seen = world @ self.view[:3, :3].T + self.view[:3, 3]
        depth: Array = -seen[..., 2]
        x = size * (0.5 + self.focal * seen[..., 0] / depth)
        y = size * (0.5 - self.focal * seen[..., 1] / depth)
        return np.stack([x, y], -1), depth
