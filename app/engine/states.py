"""Phones as the trajectory model sees them: states, and how much of each state every frame shows."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.speech import SILENCE, Phone

SILENCE_STEP = 0.05
"""Seconds. Silence near speech is split by its distance to it: the mouth closes and opens there."""
SILENCE_STEPS = 4

NEAREST: dict[str, tuple[str, ...]] = {
    "AA": ("AO", "AH", "AE"), "AE": ("EH", "AA"), "AH": ("IH", "EH", "ER"), "AO": ("AA", "OW"), "AW": ("AA", "AE"),
    "AY": ("AA", "AE"), "B": ("P", "M"), "CH": ("SH", "JH"), "D": ("T", "N"), "DH": ("TH", "D"), "EH": ("AE", "IH"),
    "ER": ("R", "AH"), "EY": ("EH", "IY"), "F": ("V",), "G": ("K", "NG"), "HH": ("AH", "EH"), "IH": ("IY", "EH"),
    "IY": ("IH", "EY"), "JH": ("CH", "SH"), "K": ("G", "NG"), "L": ("N", "D"), "M": ("B", "P"), "N": ("D", "T"),
    "NG": ("K", "G"), "OW": ("AO", "UW"), "OY": ("AO", "OW"), "P": ("B", "M"), "R": ("ER", "W"), "S": ("Z", "T"),
    "SH": ("CH", "JH", "ZH"), "T": ("D", "N"), "TH": ("DH", "T"), "UH": ("UW", "OW"), "UW": ("UH", "OW", "W"),
    "V": ("F",), "W": ("UW", "OW"), "Y": ("IY", "IH"), "Z": ("S", "D"), "ZH": ("SH", "JH", "CH"),
}  # fmt: skip
"""What an untrained phone falls back to: looks first, never silence."""

VISEMES: tuple[tuple[str, ...], ...] = (
    ("P", "B", "M"), ("F", "V"), ("TH", "DH"), ("T", "D", "N"), ("S", "Z"), ("L",), ("K", "G", "NG"),
    ("SH", "ZH", "CH", "JH"), ("R", "ER"), ("W", "UW", "UH"), ("OW", "OY", "AO"), ("AA", "AY", "AW"), ("AE",),
    ("EH", "EY"), ("IH", "IY", "Y"), ("AH", "HH"), (SILENCE,),
)  # fmt: skip
"""Phones that look alike share statistics where there are few examples."""


def lookalikes(phone: str) -> Iterator[str]:
    """A phone, then those that look like it, the most alike first (`NEAREST`, and what is nearest to these)."""
    queue, seen = [phone], set()
    while queue:
        candidate = queue.pop(0)
        if candidate not in seen:
            seen.add(candidate)
            yield candidate
            queue += NEAREST.get(candidate, ())


def nearest_phone(phone: str, trained: Collection[str]) -> str:
    """The phone itself if it was trained, else the trained one that looks most like it; never silence for speech.

    Args:
        phone: ARPAbet without stress, or silence.
        trained: among them silence and one other phone at least.
    """
    if phone == SILENCE:
        return SILENCE
    alike = (candidate for candidate in lookalikes(phone) if candidate in trained)
    return next(alike, None) or next(name for name in sorted(trained) if name != SILENCE)


_VISEME = {phone: number for number, members in enumerate(VISEMES) for phone in members}


@dataclass(frozen=True, slots=True)
class Segment:
    """One state in time (seconds). The first and last segments of a sequence reach to infinity."""

    state: str
    start: float
    end: float


@dataclass(frozen=True, slots=True)
class Occupancy:
    """Which states each frame shows, and how much of them.

    Attributes:
        states: (T, M) indices into the state names.
        share: (T, M), share of the frame's time that lies in the state; zero where unused.
        duration: (T, M), length of the state's segment in frames, capped and at least half a frame: eq. 3.1's D is
            1 / sqrt of it.
    """

    states: NDArray[np.int64]
    share: NDArray[np.float64]
    duration: NDArray[np.float64]


NEIGHBOUR = "|"
"""Between a state and the viseme beside it: `AE.0|P` is the first half of AE after P, B or M."""


def viseme(state: str) -> int:
    """Index into `VISEMES` of the class that a state's phone belongs to."""
    return _VISEME[state.partition(".")[0]]


def parent(state: str) -> str:
    """The state whatever is beside it."""
    return state.partition(NEIGHBOUR)[0]


def plain(state: str) -> str:
    """The phone of a state of speech; states of silence keep their distance to it."""
    whole = parent(state)
    return whole if whole.startswith(SILENCE) else whole.partition(".")[0]


def segments(phones: Sequence[Phone]) -> list[Segment]:
    """Split phones into states.

    Each phone is two halves: what the lips do in the first depends on the phone before it, in the second on the one
    after it (coarticulation, as far as one neighbour reaches). Silence is split by its distance to speech.
    """
    result: list[Segment] = []
    phones = silences_joined(phones)
    for index, phone in enumerate(phones):
        before = phones[index - 1].symbol if index else SILENCE
        after = phones[index + 1].symbol if index + 1 < len(phones) else SILENCE
        if phone.symbol == SILENCE:
            result += _silence(phone, before if index else "", after if index < len(phones) - 1 else "")
        else:
            middle = (phone.start + phone.end) / 2
            result.append(Segment(f"{phone.symbol}.0{_beside(before)}", phone.start, middle))
            result.append(Segment(f"{phone.symbol}.1{_beside(after)}", middle, phone.end))
    return result


def _beside(symbol: str) -> str:
    return NEIGHBOUR + VISEMES[viseme(symbol)][0]


def silences_joined(phones: Sequence[Phone]) -> list[Phone]:
    """Silences that follow each other are one: what matters is how far speech is."""
    joined: list[Phone] = []
    for phone in phones:
        if joined and joined[-1].symbol == phone.symbol == SILENCE:
            joined[-1] = Phone(SILENCE, joined[-1].start, phone.end)
        else:
            joined.append(phone)
    return joined


def _silence(phone: Phone, before: str, after: str) -> list[Segment]:
    """States of a silence between two phones; an empty name: there is none on that side."""
    half = (phone.end - phone.start) / (2 if before and after else 1)
    steps = min(SILENCE_STEPS, int(half / SILENCE_STEP + 1e-6))
    closing = steps if before else 0
    opening = steps if after else 0
    result = [
        Segment(f"SIL.after{k}{_beside(before)}", phone.start + k * SILENCE_STEP, phone.start + (k + 1) * SILENCE_STEP)
        for k in range(closing)
    ]
    rest = Segment(SILENCE, phone.start + closing * SILENCE_STEP, phone.end - opening * SILENCE_STEP)
    if rest.end - rest.start > 1e-6 or not (closing or opening):
        result.append(rest)
    result += [
        Segment(f"SIL.before{k}{_beside(after)}", phone.end - (k + 1) * SILENCE_STEP, phone.end - k * SILENCE_STEP)
        for k in reversed(range(opening))
    ]
    return result


MOST_STATES = 8
"""States that one frame can show; at 25 fps and 25 ms a phone, in halves, there are at most five."""


def occupancy(
    sequence: Sequence[Segment], names: dict[str, int], frames: int, *, fps: float, lead: float, cap: float
) -> Occupancy:
    """Share of every frame's interval that lies in each state.

    A frame is shown for 1 / fps seconds, as long as the shortest phones: giving it to one phone outright would lose
    where phones start, which is worth a third of the error.

    Args:
        sequence: segments in order, gapless.
        names: state name to index; every state of the sequence must be in it.
        frames: T.
        fps: frames a second; frame n is centred on n / fps + lead.
        lead: seconds by which the lips are ahead of the sound.
        cap: longest duration, in frames, that the duration weight knows.
    """
    states = np.zeros((frames, MOST_STATES), np.int64)
    share = np.zeros((frames, MOST_STATES))
    duration = np.ones((frames, MOST_STATES))
    half = 0.5 / fps
    starts = np.array([segment.start for segment in sequence])
    ends = np.array([segment.end for segment in sequence])
    lengths = np.clip((ends - starts) * fps, 0.5, cap)
    starts[0], ends[-1] = -np.inf, np.inf
    edges = [np.clip((side - lead) * fps, -1.0, frames) for side in (starts, ends)]
    first = np.maximum(np.floor(edges[0] - 0.5), 0).astype(np.int64)
    last = np.minimum(np.ceil(edges[1] + 0.5), frames - 1).astype(np.int64)
    counts = np.maximum(last - first + 1, 0)
    owner = np.repeat(np.arange(len(sequence)), counts)  # one row for each frame that a segment may show in
    span = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts) + first[owner]
    centre = span / fps + lead
    part = (np.minimum(centre + half, ends[owner]) - np.maximum(centre - half, starts[owner])) * fps
    order = np.flatnonzero(part > 1e-9)
    order = order[np.argsort(span[order], kind="stable")]
    owner, span, part = owner[order], span[order], part[order]
    slot = np.arange(len(span)) - np.searchsorted(span, span)  # how many of the frame's segments are before this one
    kept = slot < MOST_STATES
    owner, span, part, slot = owner[kept], span[kept], part[kept], slot[kept]
    states[span, slot] = np.array([names[segment.state] for segment in sequence])[owner]
    share[span, slot] = part
    duration[span, slot] = lengths[owner]
    return Occupancy(states, share, duration)
