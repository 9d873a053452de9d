"""What nothing was learnt from, and why: reasons that differ in their numbers only are one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from app.engine.training.take import Refusal

NUMBER = re.compile(r"\d+(?:\.\d+)?")


@dataclass(frozen=True)
class Rejection:
    """One reason and all it holds for.

    Attributes:
        reason: what was wrong; where only a number differs, from the least to the largest.
        clips: names, in order.
        frames: (clip, numbers of its pictures), in order; none for clips that were refused as a whole.
    """

    reason: str
    clips: tuple[str, ...]
    frames: tuple[tuple[str, tuple[int, ...]], ...]

    @property
    def pictures(self) -> int:
        """How many pictures of clips that were used otherwise."""
        return sum(len(numbers) for _, numbers in self.frames)


def group(refused: Sequence[Refusal], before: Iterable[tuple[str, str]] = ()) -> list[Rejection]:
    """Refusals by reason, whole clips first, then by how many pictures.

    Args:
        refused: in training.
        before: (clip, reason) of clips that training was not given.
    """
    everything = [*(Refusal(clip, None, reason) for clip, reason in before), *refused]
    by_kind: dict[str, list[Refusal]] = {}
    for refusal in everything:
        by_kind.setdefault(NUMBER.sub("N", refusal.reason), []).append(refusal)
    found = []
    for refusals in by_kind.values():
        frames: dict[str, list[int]] = {}
        for refusal in refusals:
            if refusal.frame is not None:
                frames.setdefault(refusal.take, []).append(refusal.frame)
        found.append(
            Rejection(
                _general([refusal.reason for refusal in refusals]),
                tuple(dict.fromkeys(refusal.take for refusal in refusals if refusal.frame is None)),
                tuple((take, tuple(sorted(numbers))) for take, numbers in frames.items()),
            )
        )
    return sorted(found, key=lambda each: (-len(each.clips), -each.pictures, each.reason))


def _general(reasons: Sequence[str]) -> str:
    """What reasons that differ in their numbers say together."""
    columns = zip(*(NUMBER.findall(reason) for reason in reasons), strict=True)
    ranges = []
    for numbers in columns:
        least, largest = min(numbers, key=float), max(numbers, key=float)
        ranges.append(least if float(least) == float(largest) else f"{least} to {largest}")
    found = iter(ranges)
    return NUMBER.sub(lambda _: next(found), reasons[0])


def spans(numbers: Sequence[int]) -> str:
    """Rising numbers in words: `3, 7 to 9`."""
    breaks = [place for place, (here, after) in enumerate(pairwise(numbers), 1) if after != here + 1]
    runs = [numbers[start:stop] for start, stop in pairwise([0, *breaks, len(numbers)])]
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs if len(run))
