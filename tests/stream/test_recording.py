from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from puppet import FPS, SIZE, watch_file

from app.stream.clock import FRAME_SAMPLES
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.mux import Mp4File
from app.stream.recording import Recording


def encoders() -> tuple[VideoEncoder, AacEncoder]:
    return VideoEncoder(SIZE, SIZE, FPS, preset="ultrafast"), AacEncoder()


def picture() -> np.ndarray:
    return np.full((SIZE * 3 // 2, SIZE), 128, np.uint8)


def test_a_span_out_of_a_stream_becomes_a_file(tmp_path: Path) -> None:
    video, audio = encoders()
    path = tmp_path / "a.mp4"
    recording = Recording(path, video, audio, first_frame=100)
    assert recording.needs_keyframe
    for frame in range(100, 130):
        for packet in video.encode(picture(), frame, keyframe=frame == 101):
            if frame > 100:
                recording.add(packet)
    recording.end_at(130)
    tone = np.sin(np.arange(80 * FRAME_SAMPLES) / 20).astype(np.float32)
    for packet in audio.encode(tone, 80 * FRAME_SAMPLES):
        recording.add(packet)
    assert not recording.needs_keyframe
    assert recording.has_all_sound
    assert not recording.ready
    recording.finish()
    assert recording.ready
    assert not recording.failed
    seen = watch_file(path)
    assert len(seen.times) == 29  # from its first key frame on
    assert abs(seen.video_end - seen.sound_end) < 0.04
    assert seen.loud(0.5) > 0.4
    recording.remove()
    assert list(tmp_path.iterdir()) == []
    assert recording.failed


def test_it_is_complete_when_its_last_sound_is_there(tmp_path: Path) -> None:
    video, audio = encoders()
    recording = Recording(tmp_path / "a.mp4", video, audio, first_frame=0)
    silence = np.zeros(FRAME_SAMPLES, np.float32)
    fed = 0
    while not recording.has_all_sound:
        if fed == 5:
            recording.end_at(5)
            assert not recording.has_all_sound  # the coder is a packet or two behind
        for packet in audio.encode(silence, fed * FRAME_SAMPLES):
            recording.add(packet)
        fed += 1
        assert fed < 10
    recording.remove()
    assert list(tmp_path.iterdir()) == []


def test_without_a_picture_there_is_no_file(tmp_path: Path) -> None:
    recording = Recording(tmp_path / "a.mp4", *encoders(), first_frame=0)
    recording.finish()
    assert recording.failed
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_written_fails_quietly(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    video, audio = encoders()
    recording = Recording(tmp_path / "missing" / "a.mp4", video, audio, first_frame=0)
    assert recording.failed
    assert recording.settled
    assert not recording.needs_keyframe
    for packet in video.encode(picture(), 0):
        recording.add(packet)
    recording.finish()
    assert not recording.ready
    assert "cannot be written" in caplog.text


def test_a_file_that_can_be_neither_written_nor_closed_fails_quietly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    video, audio = encoders()
    recording = Recording(tmp_path / "a.mp4", video, audio, first_frame=0)

    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(Mp4File, "add", full)
    monkeypatch.setattr(Mp4File, "discard", full)
    for packet in video.encode(picture(), 0):
        recording.add(packet)
    assert recording.failed
    assert "no space left" in caplog.text
    recording.finish()
    assert not recording.ready
