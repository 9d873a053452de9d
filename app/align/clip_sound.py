"""The sound of a video file on the clock of its picture.

Files seldom begin with both at once: containers delay one of the two, encoders put silence before the sound, cut
recordings begin with pictures that cannot be decoded. Mouths are compared with sound, so the first picture that can be
decoded is time 0 and the sound is laid beside it by its timestamps, also behind damage in the middle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from app.errors import InputError

TOLERANCE = 0.025  # 25 ms: timestamps that are off by less are rounded or jitter; the sound goes on without a seam
LONGEST_JUMP = 600.0  # 10 minutes of missing sound: a longer jump is no damage but a wrong clock
LONGEST_STEP_BACK = 1.0  # seconds that may come twice: a longer one is a clock that was set back
LEAST_SECONDS_LOST = 0.5  # seconds by which a file ends before its header says; headers estimate

Samples = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class ClipSound:
    """What is heard in a video; time 0 is the presentation time of its first picture.

    Attributes:
        samples: mono, float32 in [-1, 1], shape (n,).
        rate: samples a second.
        start: seconds from the first picture to the first sample that is in the file; before it there is silence. Less
            than 0 if sound before the first picture was cut off.
        lost: seconds of sound that is missing or damaged in the file; silence stands for what is not at the end.
    """

    samples: Samples
    rate: int
    start: float
    lost: float

    @property
    def duration(self) -> float:
        """Length in seconds, from the first picture on."""
        return len(self.samples) / self.rate


def read_clip_sound(video: Path) -> ClipSound:
    """The sound of a video on the clock of its picture.

    Several channels are mixed to one, at the rate that the sound begins with. Packets that cannot be decoded are
    silence.

    Raises:
        InputError: the file cannot be read, has no picture, no sound, or timestamps that fit to no clock; the advice
            says what to do. The message does not name the file.
    """
    try:
        if not video.stat().st_size:
            raise InputError("it is empty", advice="Copy it anew.")
        with av.open(str(video.absolute()), options={"protocol_whitelist": "file"}) as container:
            if not len(container.streams):
                raise InputError("nothing is in it", advice="It may be cut off: copy or convert it anew.")
            pictures = [each for each in container.streams.video if not _cover(each)]
            sounds = container.streams.audio
            if not pictures:
                raise InputError("it has no picture", advice="Is it a video?")
            if not sounds:
                raise InputError("it has no sound", advice="Put the sound into the file, or leave the clip out.")
            return _read(container, pictures[0], container.streams.best("audio") or sounds[0])
    except OSError as error:
        raise InputError(f"it cannot be opened: {error.strerror or error}") from error
    except av.FFmpegError as error:
        raise InputError(
            f"it cannot be read as a video: {error.strerror or error}", advice="Does a player show it? Convert it anew."
        ) from error


def _cover(stream: Any) -> bool:
    """Whether a stream is a picture of the record rather than a video."""
    return bool(stream.disposition & av.stream.Disposition.attached_pic)


def _read(container: Any, picture: Any, sound: Any) -> ClipSound:
    picture.codec_context.thread_count = 1  # one picture is decoded: others would only start threads
    origin: float | None = None
    track: _Track | None = None
    for packet in _packets(container, picture, sound):
        if packet.stream.index == picture.index:
            if origin is None:
                origin = next((_time(frame, picture) for frame in _decoded(packet)), None)
        else:
            for frame in _decoded(packet):
                track = track or _Track(frame.sample_rate, _time(frame, sound))
                track.add(frame)
    if origin is None:
        raise InputError("none of its pictures can be decoded", advice="Does a player show it? Convert it anew.")
    if track is None:
        raise InputError("none of its sound can be decoded", advice="Does a player play it? Convert it anew.")
    samples = track.samples()
    start = track.start - origin
    if start > LONGEST_JUMP:
        raise InputError(f"its sound begins {start:.0f} s after its picture", advice="Convert it anew.")
    lead = round(start * track.rate)
    samples = np.concatenate([np.zeros(lead, np.float32), samples]) if lead > 0 else samples[-lead:].copy()
    if not len(samples):
        raise InputError("its sound ends before its first picture", advice="Convert it anew.")
    missing = _stated_end(sound) - (origin + len(samples) / track.rate)
    lost = track.lost + (missing if missing > LEAST_SECONDS_LOST else 0.0)
    return ClipSound(samples, track.rate, start, lost)


def _packets(container: Any, *streams: Any) -> Iterator[Any]:
    """Packets up to the end of the file or to where it is cut off."""
    try:
        yield from container.demux(*streams)
    except av.FFmpegError:
        return


def _decoded(packet: Any) -> list[Any]:
    """The frames of a packet; none if it is damaged."""
    try:
        return list(packet.decode())
    except av.FFmpegError:
        return []


def _time(frame: Any, stream: Any) -> float:
    """When a frame is presented, seconds."""
    if frame.time is not None:
        return float(frame.time)
    return float(stream.start_time * stream.time_base) if stream.start_time is not None else 0.0


def _stated_end(stream: Any) -> float:
    """When the file says that the stream ends, seconds; 0 if it does not say."""
    if not stream.duration:
        return 0.0
    return float((stream.start_time or 0) * stream.time_base + stream.duration * stream.time_base)


@dataclass
class _Run:
    """Sound without a gap.

    Attributes:
        start: presentation time of its first sample, seconds.
        shape: sample format, channels and rate of its frames.
        mixer: brings it to mono.
        pieces: what has come out of it.
        given: samples that have gone in.
    """

    start: float
    shape: tuple[str, str, int]
    mixer: Any
    pieces: list[Samples]
    given: int = 0

    @property
    def end(self) -> float:
        return self.start + self.given / self.shape[2]

    def mix(self, frame: Any) -> None:
        self.pieces += [part.to_ndarray()[0] for part in self.mixer.resample(frame)]


class _Track:
    """Decoded sound, laid where its timestamps put it.

    Attributes:
        rate: samples a second.
        start: presentation time of the first sample, seconds.
        lost: seconds of gaps.
    """

    def __init__(self, rate: int, start: float) -> None:
        self.rate, self.start, self.lost = rate, start, 0.0
        self._runs: list[_Run] = []

    def add(self, frame: Any) -> None:
        shape = (frame.format.name, frame.layout.name, frame.sample_rate)
        run = self._runs[-1] if self._runs else None
        end = run.end if run else self.start
        gap = float(frame.time) - end if frame.time is not None else 0.0
        if gap > LONGEST_JUMP or gap < -LONGEST_STEP_BACK:
            at = end - self.start
            raise InputError(
                f"the clock of its sound jumps by {gap:+.1f} s at {at:.1f} s", advice="Cut it in two there."
            )
        if abs(gap) <= TOLERANCE:
            gap = 0.0
        if run is None or gap or shape != run.shape:
            self._finish()
            self.lost += max(gap, 0.0)
            run = _Run(end + gap, shape, av.AudioResampler("flt", "mono", self.rate), [])
            self._runs.append(run)
        run.given += frame.samples
        run.mix(frame)

    def samples(self) -> Samples:
        """All of it in [-1, 1], shape (n,)."""
        self._finish()
        laid = [(round((run.start - self.start) * self.rate), run.pieces) for run in self._runs]
        length = max((max(at, 0) + sum(map(len, pieces)) for at, pieces in laid), default=0)
        whole = np.zeros(length, np.float32)
        for at, pieces in laid:
            at = max(at, 0)
            for piece in pieces:
                whole[at : at + len(piece)] = piece
                at += len(piece)
        np.nan_to_num(whole, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        peak = float(np.abs(whole).max(initial=0.0))
        if peak > 1.0:  # channels that say the same add up
            whole /= np.float32(peak)
        return whole

    def _finish(self) -> None:
        """Let the last run's mixer give out what it holds."""
        if self._runs:
            self._runs[-1].mix(None)
