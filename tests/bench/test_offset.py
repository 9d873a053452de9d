"""The default avatar says "ah" again and again, live: what the benchmarks make of it is what was put in."""

from __future__ import annotations

import numpy as np
import pytest

from app.engine.avatar import Avatar, load_avatar
from app.engine.frame import empty, planes
from app.speech import SILENCE, Phone
from app.stream.clock import BLOCK_SAMPLES, FPS, SAMPLE_RATE
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.flv import FlvFormat
from bench.mouth import CLOSED, MouthGauge
from bench.offset import last_loud, offset, onset
from bench.recorded import FOLDER
from bench.watched import Series, Watched, look

AHS = [(0.5, 0.8), (1.1, 1.65), (1.9, 2.1), (2.6, 3.3), (3.5, 3.6), (3.9, 4.3)]
"""Seconds from and to which there is sound."""
SECONDS = 5.0
LOOP_FRAME = 100  # the loop of 125 frames begins anew on the way


@pytest.fixture(scope="module")
def avatar() -> Avatar:
    return load_avatar(FOLDER)


@pytest.fixture(scope="module")
def gauge(avatar: Avatar) -> MouthGauge:
    return MouthGauge(avatar.pack.background)


@pytest.fixture(scope="module")
def watched(avatar: Avatar, gauge: MouthGauge, tmp_path_factory: pytest.TempPathFactory) -> Watched:
    """What a viewer of `live.flv` gets."""
    edges = [0.0, *(edge for ah in AHS for edge in ah), SECONDS]
    phones = [Phone("AA" if n % 2 else SILENCE, edges[n], edges[n + 1]) for n in range(len(edges) - 1)]
    mouths = avatar.trajectory(phones, round(SECONDS * FPS))
    time = np.arange(round(SECONDS * SAMPLE_RATE)) / SAMPLE_RATE
    loud = sum((time >= start) & (time < end) for start, end in AHS)
    sound = (0.2 * np.sin(2 * np.pi * 200 * time) * loud).astype(np.float32)
    manifest = avatar.manifest
    video, audio = VideoEncoder(manifest.width, manifest.height, FPS, preset="superfast", crf=21), AacEncoder()
    flv = FlvFormat(video, audio)
    data = flv.header.data
    picture = empty(manifest.width, manifest.height)
    for n, mouth in enumerate(mouths):
        avatar.render(mouth, LOOP_FRAME + n, picture)
        packets = list(video.encode(picture, n))
        for first in range(n * 2 * BLOCK_SAMPLES, (n + 1) * 2 * BLOCK_SAMPLES, BLOCK_SAMPLES):
            packets += audio.encode(sound[first : first + BLOCK_SAMPLES], first)
        data += b"".join(chunk.data for packet in packets for chunk in flv.write(packet))
    path = tmp_path_factory.mktemp("watched") / "seen.flv"
    path.write_bytes(data)
    return look(path, gauge)


def test_the_mouth_is_closed_in_silence_and_open_in_speech(watched: Watched) -> None:
    assert len(watched.pictures) == len(watched.mouth.times) == SECONDS * FPS
    assert watched.mouth.within(0.0, 0.3).values.max() < CLOSED
    assert watched.mouth.within(4.6, 5.0).values.max() < CLOSED
    for start, end in AHS:
        assert watched.mouth.within(start, end).values.max() > 2 * CLOSED


def test_the_frame_of_the_loop_is_recognised(avatar: Avatar, gauge: MouthGauge) -> None:
    picture = empty(avatar.manifest.width, avatar.manifest.height)
    (mouth,) = avatar.trajectory([Phone("AA", 0.0, 0.04)], 1)
    for frame in (0, 1, 62, 124):
        avatar.render(mouth, frame, picture)
        assert gauge.loop_frame(planes(picture)[0]) == frame


def test_sound_begins_and_ends_when_it_does(watched: Watched) -> None:
    before = 0.0
    for start, end in AHS:
        assert onset(watched.sound, before, end) == pytest.approx(start, abs=0.02)  # AAC smears by half a packet
        assert last_loud(watched.sound, start, end + 0.1) == pytest.approx(end, abs=0.025)
        before = (start + end) / 2
    assert onset(watched.sound, 0.6, 0.7) is None  # no silence
    assert onset(watched.sound, 0.1, 0.3) is None  # no sound
    assert last_loud(watched.sound, 0.1, 0.3) is None


@pytest.mark.parametrize("moved", [-0.1, -0.013, 0.02, 0.06])
def test_a_shift_of_the_sound_is_found(watched: Watched, moved: float) -> None:
    found = offset(watched.mouth, watched.sound.later(moved)) - offset(watched.mouth, watched.sound)
    assert found == pytest.approx(moved, abs=0.003)


@pytest.mark.parametrize("frames", [-2, 1, 3])
def test_a_shift_of_the_pictures_is_found(watched: Watched, frames: int) -> None:
    mouth = watched.mouth.later(frames / FPS)
    assert offset(mouth, watched.sound) - offset(watched.mouth, watched.sound) == pytest.approx(
        -frames / FPS, abs=0.003
    )


def test_what_opens_with_the_sound_is_in_step_with_it() -> None:
    chance = np.random.default_rng(1)
    times = np.arange(0, 40, 0.0027)
    edges = np.cumsum(chance.uniform(0.15, 0.7, 120))
    speech = Series(times, np.where(np.searchsorted(edges, times) % 2, -20.0, -120.0))
    frames = np.arange(0, 40, 1 / FPS)
    for late in (0.0, 0.047, -0.15):
        spoken = np.searchsorted(edges, frames[:, None] - late + np.linspace(-0.02, 0.02, 9)) % 2
        mouth = Series(frames, 8 * spoken.mean(1) + chance.uniform(0, 0.5, len(frames)))
        assert offset(mouth, speech) == pytest.approx(-late, abs=0.01)


def test_without_speech_there_is_no_offset(watched: Watched) -> None:
    with pytest.raises(ValueError, match="no speech"):
        offset(watched.mouth, watched.sound.within(0.0, 0.4))
    with pytest.raises(ValueError, match="no speech"):
        offset(Series(watched.mouth.times, np.zeros_like(watched.mouth.values)), watched.sound)
