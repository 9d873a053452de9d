"""Sentences that were recorded, said by the avatar: trajectories, pictures, and the opening of the mouth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from app.engine.evaluation.opening import Lips
from app.engine.evaluation.reconstruction import compared
from app.engine.evaluation.talker import Talker
from app.engine.modes import draw_crop
from app.engine.pack import FPS
from app.engine.training.articulation import rest_offset, spoken_passages
from app.engine.training.corpus import Corpus, Progress
from app.engine.training.frame_store import FrameStore
from app.engine.training.take import speaking
from app.engine.training.workers import in_parallel
from app.speech import Phone

Float = NDArray[np.float32]
Array = NDArray[np.float64]
Predict = Callable[[Sequence[Phone], int], NDArray[np.float32]]
"""Any trajectory model: phones of a sentence and a number of frames to coefficients (T, K)."""

SHOWN = ("predicted", "neutral", "analysed")
"""Mouths drawn for every frame: what the model says, the mouth at rest, and the best that could be drawn."""


@dataclass(frozen=True)
class Sentence:
    """One passage as it was recorded and as the avatar says it.

    Attributes:
        name: of its take, and its number in it if there are several.
        phones: times from its first frame.
        numbers: (T,) of its frames in the corpus.
        counted: (T,) which frames could be read.
        speech: (T,) which of them show speech.
        true: (T, K) analysed coefficients without the passage's own offset at rest.
        predicted: (T, K).
        offset: (K,) that offset.
    """

    name: str
    phones: tuple[Phone, ...]
    numbers: NDArray[np.int64]
    counted: NDArray[np.bool_]
    speech: NDArray[np.bool_]
    true: Float
    predicted: Float
    offset: Float


@dataclass(frozen=True)
class Drawn:
    """A sentence's pictures, measured.

    Attributes:
        scores: (T, 3, 2) PSNR and SSIM of each of `SHOWN` in the mouth box; NaN for frames that were not read.
        recorded, shown: (T,) opening of the recorded mouth and of the predicted one; NaN likewise.
    """

    scores: Array
    recorded: Array
    shown: Array


def sentences(corpus: Corpus, coefficients: Float, rest: Float, predict: Predict) -> list[Sentence]:
    """Every passage of a corpus in which something is said and seen.

    Args:
        corpus: whose passages.
        coefficients: (T, K) of all frames.
        rest: (K,) the avatar's mouth at rest.
        predict: the trajectory model.
    """
    found = []
    several = {passage.take for passage in corpus.passages if passage.first > 0}
    for passage, spoken in zip(corpus.passages, spoken_passages(corpus, coefficients, rest), strict=True):
        numbers = np.arange(passage.frames.start, passage.frames.stop)
        speech = speaking(spoken.phones, len(numbers)) & spoken.counted
        if not speech.any():
            continue
        name = corpus.takes[passage.take].name
        if passage.take in several:
            name += f" ({passage.first / FPS:.1f} s)"
        found.append(
            Sentence(
                name, spoken.phones, numbers, spoken.counted, speech, spoken.coefficients,
                predict(spoken.phones, len(numbers)).astype(np.float32),
                rest_offset(corpus, coefficients, rest, numbers).astype(np.float32),
            )
        )  # fmt: skip
    return found


def louder(sentence: Sentence, rest: Float, gain: float) -> Sentence:
    """A sentence whose predicted mouth moves `gain` times as far from rest."""
    return replace(sentence, predicted=(rest + gain * (sentence.predicted - rest)).astype(np.float32))


def draw(
    said: Sequence[Sentence], corpus: Corpus, talker: Talker, lips: Lips, *, workers: int = 0,
    progress: Progress = lambda *_: None,
) -> list[Drawn]:  # fmt: skip
    """Draw sentences and compare them with what was recorded.

    Args:
        said: of this corpus.
        corpus: whose frames.
        talker: whose model.
        lips: where the opening is measured.
        workers: processes; 0 for one a core.
        progress: told the share done.
    """
    work = partial(_draw, frames=corpus.frames, talker=talker, lips=lips)
    return list(in_parallel(work, said, workers=workers, progress=lambda share: progress("drawing", share)))


def _draw(sentence: Sentence, frames: FrameStore, talker: Talker, lips: Lips) -> Drawn:
    modes, reader = talker.modes, talker.reader
    size = (modes.height, modes.width)
    rest = talker.trajectory.rest
    count = len(sentence.numbers)
    drawn = Drawn(np.full((count, len(SHOWN), 2), np.nan), np.full(count, np.nan), np.full(count, np.nan))
    seen = np.flatnonzero(sentence.counted)
    pictures = frames.take(sentence.numbers[seen])[:, : size[0] * size[1]].reshape(-1, *size)
    mouths = (
        [sentence.predicted[at] + sentence.offset for at in seen],
        [rest + sentence.offset] * len(seen),
        [sentence.true[at] + sentence.offset for at in seen],
    )
    for place, coefficients in enumerate(mouths):
        shown = [draw_crop(modes, each).luma for each in coefficients]
        drawn.scores[seen, place] = compared(shown, list(pictures), talker)
        if place == 0:
            drawn.shown[seen] = [lips.opening(reader.flow(picture)) for picture in shown]
    drawn.recorded[seen] = [lips.opening(reader.flow(picture)) for picture in pictures]
    return drawn
