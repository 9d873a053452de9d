from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from puppet import BACKGROUND, FPS, OPEN, SIZE, TinyAvatar

from app.engine.pool import FrameJob
from app.stream.broadcast import Broadcast
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.film import Film
from app.stream.packet import Packet
from app.stream.recording import Recording
from app.stream.timeline import Look
from app.stream.utterance import Utterance


@pytest.fixture
def starts() -> list[int]:
    return []


@pytest.fixture
def film(starts: list[int]) -> Film:
    encoder = VideoEncoder(SIZE, SIZE, FPS, preset="ultrafast")
    return Film(TinyAvatar(), encoder, Broadcast[Packet](), lambda: starts.append(1))


def job(index: int, *, keyframe: bool = False, owner: Utterance | None = None) -> FrameJob:
    mouth = None if owner is None else np.ones(2, np.float32)
    return FrameJob(index, 0.0, Look(mouth, index, keyframe, owner))


def test_a_frame_is_drawn_encoded_published_and_timed(film: Film, starts: list[int]) -> None:
    utterance = Utterance(5)
    idle, speaking = film.draw(job(0)), film.draw(job(1, owner=utterance))
    assert (idle[0, 0], speaking[0, 0]) == (BACKGROUND, OPEN)
    assert list(utterance.timings.milliseconds()) == ["first_frame"]
    film.encode(job(0, keyframe=True), idle)
    film.encode(job(1, owner=utterance), speaking)
    assert list(utterance.timings.milliseconds()) == ["first_frame", "first_packet"]
    assert film.passed == 1
    assert starts == [1]
    kept = [(packet.pts, packet.keyframe, packet.idle) for packet in film._broadcast._cache]
    assert kept == [(0, True, True), (1, False, False)]


def test_an_utterance_is_drawn_by_the_face_that_was_asked_for_it(film: Film) -> None:
    class Blank(TinyAvatar):
        def render(self, *given: object) -> None:
            given[-1][:] = 77  # type: ignore[index]

    blank = Utterance(5, face=Blank())  # type: ignore[arg-type]
    assert film.draw(job(0, owner=blank))[0, 0] == 77
    assert film.draw(job(1, owner=Utterance(5)))[0, 0] == OPEN
    assert film.draw(job(2))[0, 0] == BACKGROUND


def test_a_dropped_start_makes_the_next_frame_the_start(film: Film) -> None:
    film.encode(job(0, keyframe=True), film.draw(job(0)))
    film.dropped(job(20, keyframe=True))
    film.dropped(job(21))
    assert film.passed == 21
    film.encode(job(22), film.draw(job(22)))
    assert [packet.pts for packet in film._broadcast._cache] == [22]


def test_of_errors_in_a_row_the_first_is_told(film: Film, caplog: pytest.LogCaptureFixture) -> None:
    for number in range(20):
        film.failed(ValueError(f"no {number}"))
    assert [record.message for record in caplog.records] == ["a frame cannot be made"]
    assert "no 0" in caplog.text
    film.encode(job(0), film.draw(job(0)))
    film.encode(job(1), film.draw(job(1)))
    assert "again after 20 errors" in caplog.text
    assert len(caplog.records) == 2
    film.failed(ValueError("once more"))
    assert len(caplog.records) == 3


def test_a_file_that_failed_asks_for_no_key_frames(film: Film, tmp_path: Path) -> None:
    utterance = Utterance(1)
    utterance.recording = Recording(tmp_path / "missing" / "a.mp4", film._encoder, AacEncoder(), first_frame=0)
    for index in range(3):
        film.encode(job(index, owner=utterance), film.draw(job(index, owner=utterance)))
    assert [packet.keyframe for packet in film._broadcast._cache] == [True, False, False]
