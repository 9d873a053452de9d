"""How well two sets of phone times for the same sound agree."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import SequenceMatcher

import numpy as np
from numpy.typing import NDArray

from app.speech import SILENCE, Phone


def start_differences(ours: Sequence[Phone], theirs: Sequence[Phone]) -> NDArray[np.float64]:
    """Seconds by which our phones begin later than theirs.

    Phones are matched in order; what only one side has is passed over, silences too. A phone after a silence counts: an
    onset is what a viewer sees best.

    Returns:
        shape (n,), n the number of phones that both have.
    """
    one, other = ([phone for phone in each if phone.symbol != SILENCE] for each in (ours, theirs))
    matcher = SequenceMatcher(None, [each.symbol for each in one], [each.symbol for each in other], autojunk=False)
    return np.array(
        [
            one[block.a + at].start - other[block.b + at].start
            for block in matcher.get_matching_blocks()
            for at in range(block.size)
        ]
    )
