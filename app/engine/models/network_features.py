"""What the network reads of every frame: the phones around it, and the sound around it.

Nothing later than 0.28 s (phones) or 0.2 s (sound) after a frame is read, so that live sound and live text can be
spoken from as whole sentences are.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.engine.models.mfcc import COUNT, RATE, mfcc
from app.engine.models.sound import Sound
from app.engine.states import nearest_phone
from app.speech import PHONES, SILENCE, Phone

Float = NDArray[np.float32]
Array = NDArray[np.float64]

BEFORE, AFTER, HEARD_AFTER = 6, 6, 4
"""Frames that are read before each, and after it of phones and of sound."""
LEAD = 0.02
"""Seconds by which phones are read ahead of the frame; `BEFORE` and `AFTER` leave room for other talkers."""
LOOK, HEARD_LOOK = 0.28, 0.2
"""Seconds after a frame from which on no phones and no sound are read: the frames after it, half of one, and `LEAD`."""
NEIGHBOURS = (-2, -1, 0, 1, 2)
"""Phones that are read, counted from the one that sounds."""
LONG = 0.4
"""Seconds; longer phones count as so long."""
TIE = 1e-6
"""Seconds; what begins at the very moment has begun, whatever clock it is measured by."""
TENTH = 0.1
"""Seconds that a time feature of one means."""
PARTS, TAKEN = 2, 4
"""Parts of each frame's sound that are told apart, and spectra whose mean each of them is."""
WIDEST = 4.0
"""Standard deviations of a cepstral coefficient; others count as so far away."""

PHONE_FEATURES = (BEFORE + 1 + AFTER + len(NEIGHBOURS)) * len(PHONES) + 3
SOUND_FEATURES = (BEFORE + 1 + HEARD_AFTER) * PARTS * COUNT

_INDEX = {symbol: at for at, symbol in enumerate(PHONES)}


def phone_features(phones: Sequence[Phone], first: int, count: int, fps: float, trained: Collection[str]) -> Float:
    """What is read of the phones.

    Args:
        phones: gapless; before the first and after the last, these two go on. None at all are silence.
        first: number of the first frame; frame n is at n / fps.
        count: how many frames.
        fps: frames a second.
        trained: phones that the network knows, silence among them; others are read as what looks most like them.

    Returns:
        (count, PHONE_FEATURES): share of each phone in each of the frames around, which phones come before and after,
        how long the one that sounds has lasted and will last, and how long the one before did.
    """
    joined = _joined(phones, trained)
    symbols = np.array([_INDEX[symbol] for symbol, _, _ in joined])
    starts = np.array([start for _, start, _ in joined], np.float64)
    ends = np.array([end for _, _, end in joined], np.float64)
    shares = _shares(symbols, starts, ends, np.arange(first - BEFORE, first + count + AFTER) / fps + LEAD, 0.5 / fps)
    now = np.arange(first, first + count) / fps + LEAD + TIE
    place = np.minimum(np.searchsorted(ends, now, side="right"), len(joined) - 1)
    columns = [windows(shares, count, AFTER)]
    for distance in NEIGHBOURS:
        there = np.clip(place + distance, 0, len(joined) - 1)
        inside = (place + distance >= 0) & (place + distance < len(joined))
        shown = np.eye(len(PHONES))[np.where(inside, symbols[there], _INDEX[SILENCE])]
        begins = np.where(place + distance < len(joined), starts[there], ends[-1])
        columns.append(shown * (begins < now + LOOK - LEAD)[:, None])
    earlier = np.maximum(place - 1, 0)
    lasted = np.where(place > 0, now - starts[place], LONG)
    left = np.where(place < len(joined) - 1, ends[place] - now, LONG)
    length = np.where(place > 0, ends[earlier] - starts[earlier], LONG)
    times = (np.clip(lasted, 0, LONG), np.clip(left, 0, LOOK - LEAD), np.clip(length, 0, LONG))
    return np.concatenate([*columns, np.stack(times, 1) / TENTH], 1).astype(np.float32)


@dataclass(frozen=True)
class Hearing:
    """How a talker's recording sounds, which all sound is measured by.

    Attributes:
        mean, deviation: (COUNT,) of its cepstral coefficients.
        quiet: (COUNT,) those of its pauses. Sound that is less loud counts as these: no microphone is heard twice.
        voice, spread: (COUNT,) mean and standard deviation over its sentences of each sentence's mean while it is loud.
        limit: root mean square distance from `voice`, in `spread`, within which a voice is the talker's.
    """

    mean: Float
    deviation: Float
    quiet: Float
    voice: Float
    spread: Float
    limit: float

    def features(self, sound: Sound, first: int, count: int, fps: float) -> Float:
        """(count, SOUND_FEATURES) of the frames from number `first` on; frame n is at n / fps, as with phones."""
        frames = count + BEFORE + HEARD_AFTER
        steps = PARTS * TAKEN
        centres = (first - BEFORE - 0.5 + (np.arange(frames * steps) + 0.5) / steps) / fps
        near = cut(sound, float(centres[0]), float(centres[-1]))
        return self.read(mfcc(near.heard, centres - near.start), count)

    def read(self, cepstra: Float, count: int) -> Float:
        """The same from cepstra of all frames around, `PARTS * TAKEN` of each frame."""
        heard = np.where(cepstra[:, :1] < self.quiet[0], self.quiet, cepstra)
        heard = np.clip((heard - self.mean) / self.deviation, -WIDEST, WIDEST)
        heard = heard.reshape(-1, TAKEN, COUNT).mean(1).reshape(-1, PARTS * COUNT)
        return windows(heard, count, HEARD_AFTER).astype(np.float32)

    def knows(self, sound: Sound, end: float) -> bool:
        """Whether this is the talker's voice, from half a second of loud sound or more before `end` (seconds).

        A network that has heard one voice only hears other phones in others.
        """
        mean = loud_mean(_track(sound, end), float(self.quiet[0]), float(self.mean[0] + self.deviation[0] / 2))
        return mean is not None and self.distance(mean) <= self.limit

    def distance(self, mean: Float) -> float:
        """Of a sentence's mean cepstrum, its loudness aside, from the talker's."""
        return float(np.sqrt(np.mean(((mean - self.voice) / self.spread)[1:] ** 2)))


LEAST_LOUD = 0.5
"""Seconds of loud sound that tell whose voice it is."""
STEP = 0.01
"""Seconds between the cepstra that voices are compared by."""
MARGIN = 0.05
"""Seconds of sound that windows and resampling reach over."""
HEARD = 0.5
"""Seconds before a sentence that its voice is known from, too."""
QUIET_SHARE = 0.05
"""Of a recording's cepstra, those that are its pauses."""


def learn_hearing(sounds: Sequence[Sound], ends: Sequence[float]) -> Hearing:
    """What a recording sounds like; sentences without enough loud sound do not tell the voice.

    Args:
        sounds: of each sentence, from time 0 on.
        ends: when each of them ends, seconds.
    """
    tracks = [_track(sound, end) for sound, end in zip(sounds, ends, strict=True)]
    heard = np.concatenate(tracks).astype(np.float64)
    mean, deviation = heard.mean(0), np.maximum(heard.std(0), 1e-3)
    quiet = heard[heard[:, 0] <= np.quantile(heard[:, 0], QUIET_SHARE)].mean(0)
    means = [loud_mean(track, quiet[0], mean[0] + deviation[0] / 2) for track in tracks]
    known = np.array([each for each in means if each is not None] or [mean])
    spread = np.maximum(known.std(0), 0.1 * deviation)
    mean, deviation, quiet, middle, spread = (
        each.astype(np.float32) for each in (mean, deviation, quiet, known.mean(0), spread)
    )
    hearing = Hearing(mean, deviation, quiet, middle, spread, limit=0.0)
    limit = 1.25 * max(2.0, *(hearing.distance(each) for each in known), 0.0)
    return replace(hearing, limit=limit)


def loud_mean(track: Float, quiet: float, loud: float) -> Float | None:
    """(COUNT,) mean of the loud cepstra of a track; None if there are too few.

    Args:
        track: (n, COUNT), every `STEP`.
        quiet: loudness of the recording's pauses.
        loud: loudness from which on it counts, if this is as loud as the recording; else half way from its pauses to
            its loudest.
    """
    if not len(track):
        return None
    threshold = min(loud, (quiet + float(np.quantile(track[:, 0], 0.95))) / 2)
    chosen = track[track[:, 0] >= threshold]
    if len(chosen) * STEP < LEAST_LOUD or threshold <= quiet:
        return None
    return np.asarray(chosen.mean(0), np.float32)


def windows(rows: NDArray[Any], count: int, after: int) -> NDArray[Any]:
    """(count, (BEFORE + 1 + after) * F): each row with those before and after it, of (BEFORE + count + after, F)."""
    return np.concatenate([rows[at : at + count] for at in range(BEFORE + 1 + after)], 1)


def cut(sound: Sound, start: float, end: float) -> Sound:
    """What is heard from `start` to `end` (seconds), and `MARGIN` around it: a take may be an hour long."""
    first = max(0, int((start - MARGIN - sound.start) * sound.rate))
    last = max(first, int((end + MARGIN - sound.start) * sound.rate))
    return Sound(sound.samples[first:last], sound.rate, sound.start + first / sound.rate)


def _track(sound: Sound, end: float) -> Float:
    """(n, COUNT) every `STEP` from time 0, or what is heard just before, to `end`."""
    near = cut(sound, -HEARD, end)
    start, stop = max(-HEARD, near.start), min(end, near.start + len(near.heard) / RATE)
    return mfcc(near.heard, np.arange(start + STEP / 2, max(stop, start + STEP), STEP) - near.start)


def _joined(phones: Sequence[Phone], trained: Collection[str]) -> list[tuple[str, float, float]]:
    """Symbol, start and end of each phone, silences that follow each other as one."""
    joined: list[tuple[str, float, float]] = []
    for phone in phones or [Phone(SILENCE, 0.0, 1.0)]:
        if joined and joined[-1][0] == phone.symbol == SILENCE:
            joined[-1] = (SILENCE, joined[-1][1], phone.end)
        else:
            joined.append((nearest_phone(phone.symbol, trained), phone.start, phone.end))
    return joined


def _shares(symbols: NDArray[np.int64], starts: Array, ends: Array, centres: Array, half: float) -> Array:
    """(n, phones): how much of the time within `half` of each centre each phone takes."""
    starts, ends = starts.copy(), ends.copy()
    starts[0], ends[-1] = -np.inf, np.inf
    begin = np.maximum(centres[:, None] - half, starts)
    part = np.clip(np.minimum(centres[:, None] + half, ends) - begin, 0, None) / (2 * half)
    shares: Array = part @ np.eye(len(PHONES))[symbols]
    return shares
