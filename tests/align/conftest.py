"""Sound to align: sentences spoken with known times, and a real talker if the recordings are there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from recordings import SENTENCES, Clip

from app.align.pocketsphinx import PocketSphinxAligner
from app.align.transcript import read_transcript
from app.speech import Speech
from app.tts.hibari import HibariEngine

GRID = Path(os.environ.get("MARY_GRID") or Path(__file__).resolve().parents[3] / "shared" / "data" / "grid_s1")


@pytest.fixture(scope="session")
def spoken() -> tuple[Speech, ...]:
    """`SENTENCES` in hibari's voice, with its own phone times."""
    engine = HibariEngine()
    return tuple(engine.speak(sentence) for sentence in SENTENCES)


@pytest.fixture(scope="session")
def sphinx() -> Iterator[PocketSphinxAligner]:
    with PocketSphinxAligner() as aligner:
        yield aligner


@pytest.fixture(scope="session")
def grid() -> Path:
    """The folder of a real talker's clips."""
    if not (GRID / "test").is_dir():
        pytest.skip(f"no recordings of the GRID corpus in {GRID} (MARY_GRID names another folder)")
    return GRID


@pytest.fixture(scope="session")
def clips() -> tuple[Clip, ...]:
    """Eight sentences of a real talker."""
    paths = sorted((GRID / "test").glob("*.mpg"))[::4]
    if not paths:
        pytest.skip(f"no recordings of the GRID corpus in {GRID} (MARY_GRID names another folder)")
    return tuple(Clip(path.stem, *_sound(path), read_transcript(path.with_suffix(".align"))) for path in paths)


def _sound(path: Path) -> tuple[NDArray[np.float32], int]:
    with av.open(str(path)) as container:
        stream = container.streams.audio[0]
        mono = av.AudioResampler("flt", "mono", stream.rate)
        frames = [part.to_ndarray()[0] for frame in container.decode(stream) for part in mono.resample(frame)]
        return np.concatenate(frames), stream.rate
