from __future__ import annotations

import numpy as np

from app.align.phone_agreement import start_differences
from app.speech import Phone


def phones(*timed: tuple[str, float]) -> list[Phone]:
    return [Phone(symbol, start, start + 0.05) for symbol, start in timed]


def test_what_both_have_is_compared() -> None:
    ours = phones(("SIL", 0.0), ("HH", 0.11), ("AH", 0.2), ("L", 0.3), ("OW", 0.42))
    theirs = phones(("HH", 0.1), ("EH", 0.2), ("L", 0.31), ("SIL", 0.35), ("OW", 0.4))
    np.testing.assert_allclose(start_differences(ours, theirs), [0.01, -0.01, 0.02], atol=1e-9)
    assert start_differences(ours, ()).shape == (0,)
