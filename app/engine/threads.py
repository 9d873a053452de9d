"""Library-internal threads off: the engine is parallel over frames, and threads inside a frame only get in the way."""

from __future__ import annotations

import cv2
from threadpoolctl import threadpool_limits


def one_thread_a_call() -> None:
    """From now on no call of BLAS, OpenMP or OpenCV in this process starts threads (Fu 2011, 4.2.1, tells why)."""
    cv2.setNumThreads(1)
    threadpool_limits(1)
