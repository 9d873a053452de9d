"""The S-shaped ramp that every soft edge in the studio is made of."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def smoothstep(start: float, end: float, value: Any) -> NDArray[np.float64]:
    """0 up to `start`, 1 from `end` on, 3t^2 - 2t^3 between; falls instead of rises if `end` is below `start`."""
    share = np.clip((value - start) / (end - start), 0, 1)
    ramp: NDArray[np.float64] = share * share * (3 - 2 * share)
    return ramp
