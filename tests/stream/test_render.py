from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from puppet import FPS, TinyAvatar, speech, watch_file

from app.config import Settings
from app.engine.pool import OrderedPool
from app.errors import NothingToSay
from app.speech import SILENCE, Speech
from app.stream.render import render_file

SETTINGS = Settings(render={"preset": "ultrafast", "crf": 10})


@pytest.fixture
def pool() -> Iterator[OrderedPool]:
    pool = OrderedPool(2)
    yield pool
    pool.close()


def minute() -> list[Speech]:
    """60 s in pieces that never end on a frame, at a rate that never divides."""
    random = np.random.default_rng(7)
    pieces: list[Speech] = []
    while sum(piece.duration for piece in pieces) < 60:
        voiced, silent = random.uniform(0.15, 1.5), random.uniform(0.1, 0.6)
        pieces.append(speech(("AA", voiced), (SILENCE, silent)))
    return pieces


def test_a_minute_keeps_sound_and_picture_together_to_the_end(tmp_path: Path, pool: OrderedPool) -> None:
    pieces = minute()
    assert len(pieces) > 40
    path = tmp_path / "minute.mp4"
    frames = render_file(TinyAvatar(), pieces, SETTINGS, path, pool)
    seen = watch_file(path)
    assert list(tmp_path.iterdir()) == [path]
    assert len(seen.times) == frames
    np.testing.assert_allclose(np.diff(seen.times), 1 / FPS, atol=1e-4)
    assert abs(seen.video_end - seen.sound_end) < 0.04
    assert abs(seen.times[0] - seen.sound_start) < 0.025
    assert seen.video_end == pytest.approx(sum(piece.duration for piece in pieces) + 0.2, abs=0.05)

    # The mouth opens and closes with the sound, to within a frame, from the first piece to the last.
    edges = np.cumsum([0.0, *(p.end - p.start for piece in pieces for p in piece.phones)])
    shown = np.flatnonzero(np.diff((seen.upper > 120).astype(int), prepend=0, append=0))
    changes = seen.times[0] + np.minimum(shown, frames) / FPS
    assert len(changes) == len(edges) - 1
    for expected, change in zip(edges, changes, strict=False):
        assert expected - 1e-3 <= change < expected + 1 / FPS + 1e-3
        if expected:
            before, after = seen.loud(expected - 0.06), seen.loud(expected + 0.02)
            assert (before > 0.1) != (after > 0.1)


def test_the_background_runs_from_its_start_or_as_told(tmp_path: Path, pool: OrderedPool) -> None:
    render_file(TinyAvatar(), [speech(("AA", 3.0))], SETTINGS, tmp_path / "a.mp4", pool)
    moving = watch_file(tmp_path / "a.mp4").lower
    np.testing.assert_allclose(moving, [30 + 4 * (n % 50) for n in range(len(moving))], atol=3)
    render_file(TinyAvatar(), [speech(("AA", 1.0))], SETTINGS, tmp_path / "b.mp4", pool, loop_frame=lambda _frame: 7)
    still = watch_file(tmp_path / "b.mp4").lower
    np.testing.assert_allclose(still, 58, atol=2)


def test_progress_is_told_and_other_files_are_made_at_the_same_time(tmp_path: Path, pool: OrderedPool) -> None:
    told: list[int] = []
    threads = [
        threading.Thread(
            target=render_file, args=(TinyAvatar(), [speech(("AA", 1.0))] * 2, SETTINGS, tmp_path / f"{n}.mp4", pool)
        )
        for n in range(3)
    ]
    for thread in threads:
        thread.start()
    frames = render_file(TinyAvatar(), minute()[:3], SETTINGS, tmp_path / "own.mp4", pool, on_frame=told.append)
    for thread in threads:
        thread.join()
    assert told == list(range(1, frames + 1))
    assert len(list(tmp_path.iterdir())) == 4
    assert pool._lanes == []


def test_nothing_to_say_leaves_nothing(tmp_path: Path, pool: OrderedPool) -> None:
    with pytest.raises(NothingToSay):
        render_file(TinyAvatar(), [], SETTINGS, tmp_path / "a.mp4", pool)
    assert list(tmp_path.iterdir()) == []


def test_an_error_of_the_speech_or_the_renderer_leaves_nothing(tmp_path: Path, pool: OrderedPool) -> None:
    def speeches() -> Iterator[Speech]:
        yield speech(("AA", 2.0))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_file(TinyAvatar(), speeches(), SETTINGS, tmp_path / "a.mp4", pool)

    class Broken(TinyAvatar):
        def render(self, coefficients, loop_frame, out) -> None:  # type: ignore[no-untyped-def]
            if loop_frame == 20:
                raise ValueError("no such picture")
            super().render(coefficients, loop_frame, out)

    with pytest.raises(ValueError, match="no such picture"):
        render_file(Broken(), [speech(("AA", 2.0))], SETTINGS, tmp_path / "b.mp4", pool)
    assert list(tmp_path.iterdir()) == []
    assert pool._lanes == []
