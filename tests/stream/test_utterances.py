from __future__ import annotations

from pathlib import Path

import pytest
from puppet import FPS, SIZE

from app.errors import NotFound, NotReady
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.recording import Recording
from app.stream.utterance import Utterance
from app.stream.utterances import KEPT_UTTERANCES, Utterances


def recording(folder: Path) -> Recording:
    return Recording(folder / "a.mp4", VideoEncoder(SIZE, SIZE, FPS), AacEncoder(), first_frame=0)


def test_the_oldest_are_forgotten() -> None:
    said = Utterances()
    made = []
    for _ in range(KEPT_UTTERANCES + 5):
        made.append(Utterance(1))
        said.add(made[-1])
        made[-1].finish("interrupted")
    assert list(said) == made[5:]
    assert len(said.reports()) == len(said) == KEPT_UTTERANCES
    with pytest.raises(NotFound):
        said.find(made[4].id)
    assert said.find(made[5].id) is made[5]


def test_what_is_not_finished_is_not_forgotten_nor_what_is_being_written(tmp_path: Path) -> None:
    said = Utterances()
    first = Utterance(1)
    said.add(first)
    for _ in range(KEPT_UTTERANCES):
        said.add(Utterance(1))
    assert said.find(first.id) is first
    first.recording = recording(tmp_path)
    first.finish("done")
    said.add(Utterance(1))
    assert said.find(first.id) is first
    first.recording.finish()
    said.add(Utterance(1))
    with pytest.raises(NotFound):
        said.find(first.id)
    assert list(tmp_path.iterdir()) == []


def test_a_video_is_there_when_it_is_finished_until_it_expires(tmp_path: Path) -> None:
    said = Utterances()
    with pytest.raises(NotFound, match="nothing has been said"):
        said.video()
    utterance = Utterance(1)
    said.add(utterance)
    with pytest.raises(NotReady):
        said.video()
    utterance.recording = recording(tmp_path)
    utterance.finish("done")
    with pytest.raises(NotReady):
        said.video(utterance.id)
    utterance.recording.ready = True  # as after its `finish`
    assert said.video() == said.video(utterance.id) == tmp_path / "a.mp4"
    utterance.recording.finished_at = 1e12
    assert said.expire(1.0)
    utterance.recording.finished_at = -1e12
    assert not said.expire(1.0)
    with pytest.raises(NotFound, match="no video"):
        said.video()
    assert list(tmp_path.iterdir()) == []
