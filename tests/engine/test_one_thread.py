from __future__ import annotations

import cv2
import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from app.engine.threads import one_thread_a_call


def test_from_now_on_libraries_start_no_threads() -> None:
    np.ones((64, 64)) @ np.ones((64, 64))
    threadpool_limits(2)
    cv2.setNumThreads(2)
    one_thread_a_call()
    assert cv2.getNumThreads() == 1
    pools = threadpool_info()
    assert pools
    assert all(pool["num_threads"] == 1 for pool in pools), pools
