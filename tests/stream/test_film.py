from __future__ import annotations

import numpy as np
import pytest
from puppet import BACKGROUND, FPS, OPEN, SIZE, TinyAvatar

from app.engine.pool import FrameJob
from app.stream.broadcast import Broadcast
from app.stream.encoder import VideoEncoder
from app.stream.film import Film
from app.stream.packet import Packet
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
    assert [(packet.pts, packet.keyframe) for packet in film._broadcast._cache] == [(0, True), (1, False)]


def test_a_dropped_start_makes_the_next_frame_the_start(film: Film) -> None:
    film.encode(job(0, keyframe=True), film.draw(job(0)))
    film.dropped(job(20, keyframe=True))
    film.dropped(job(21))
    assert film.passed == 21
    film.encode(job(22), film.draw(job(22)))
    assert [packet.pts for packet in film._broadcast._cache] == [22]
