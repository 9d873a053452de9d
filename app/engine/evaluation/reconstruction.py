"""How well analysed frames are drawn again: by the serving modes, by the literal model, and by its fast form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from app.engine.evaluation.literal import LiteralReader, prototype_modes
from app.engine.evaluation.talker import Talker
from app.engine.metrics import PictureScores, picture_scores, psnr, ssim
from app.engine.mmm import common_textures
from app.engine.modes import Modes, draw_crop
from app.engine.training.corpus import Corpus, Progress
from app.engine.training.frame_store import FrameStore
from app.engine.training.layout import importance
from app.engine.training.workers import in_parallel

Float = NDArray[np.float32]
Array = NDArray[np.float64]

SAMPLED = 400
"""Frames drawn by the literal model at most, evenly spread: each costs as many warps as there are prototypes."""
RENDERERS = ("serving", "literal", "fast")


@dataclass(frozen=True, slots=True)
class Reconstruction:
    """Pictures of analysed frames against the frames, and the two forms of the literal model against each other.

    Attributes:
        sampled: frames drawn, of `available`.
        available: frames that could have been.
        speech: by renderer, frames in which something is said.
        all: by renderer, all frames drawn.
        fast_minus_literal: difference of their mean PSNR in speech, dB; None if no frame of speech was drawn.
        fast_against_literal: the fast form's pictures against the literal one's, all frames drawn.
    """

    sampled: int
    available: int
    speech: dict[str, PictureScores | None]
    all: dict[str, PictureScores | None]
    fast_minus_literal: float | None
    fast_against_literal: PictureScores | None


@dataclass(frozen=True)
class _Bench:
    """A talker's forms, made once in each process."""

    talker: Talker

    @cached_property
    def textures(self) -> Float:
        """(N, P) of the prototypes on one grid."""
        return common_textures(self.talker.morphable)

    @cached_property
    def literal(self) -> LiteralReader:
        """Reads (alpha, beta)."""
        layout = self.talker.layout
        return LiteralReader(self.talker.morphable, importance(layout.crop, layout.side), self.textures)

    @cached_property
    def fast(self) -> Modes:
        """Whose coefficients are (alpha, beta)."""
        return prototype_modes(self.talker.morphable, self.textures, self.talker.modes.layer)

    def drawn(self, frame: NDArray[np.uint8]) -> dict[str, Float]:
        """Luma (H, W) of one frame (P,) by every renderer, and as recorded."""
        talker, reader = self.talker, self.talker.reader
        flow = reader.flow_of(frame)
        alpha, beta = self.literal(frame, flow)
        size = talker.modes.width * talker.modes.height
        return {
            "recorded": frame[:size].reshape(talker.modes.height, talker.modes.width).astype(np.float32),
            "serving": draw_crop(talker.modes, reader.coefficients(frame, flow)).luma,
            "literal": talker.morphable.synthesise(alpha, beta).luma,
            "fast": draw_crop(self.fast, np.concatenate([alpha, beta])).luma,
        }


def reconstruct(
    corpus: Corpus, talker: Talker, numbers: NDArray[np.int64], speech: NDArray[np.bool_], *, workers: int = 0,
    most: int = SAMPLED, progress: Progress = lambda *_: None,
) -> Reconstruction:  # fmt: skip
    """Draw frames again and compare.

    Args:
        corpus: whose frames.
        talker: whose model.
        numbers: frames that may be drawn.
        speech: (T,) which frames of the corpus show speech.
        workers: processes; 0 for one a core.
        most: frames drawn at most.
        progress: told the share done.
    """
    chosen = numbers[np.unique(np.linspace(0, len(numbers) - 1, min(most, len(numbers))).round().astype(int))]
    pieces = [chosen[start : start + 32] for start in range(0, len(chosen), 32)]
    work = partial(_compare, frames=corpus.frames, talker=talker)
    found = np.concatenate(
        list(in_parallel(work, pieces, workers=workers, progress=lambda share: progress("reconstruction", share)))
    )
    spoken = speech[chosen]
    in_speech, everywhere = (_scores(found[kept]) for kept in (spoken, np.ones(len(found), bool)))
    literal, fast = in_speech["literal"], in_speech["fast"]
    return Reconstruction(
        len(chosen), len(numbers), in_speech, everywhere,
        fast.psnr - literal.psnr if fast and literal else None,
        picture_scores(found[:, 3, 0], found[:, 3, 1]),
    )  # fmt: skip


def _scores(found: Array) -> dict[str, PictureScores | None]:
    return {name: picture_scores(found[:, at, 0], found[:, at, 1]) for at, name in enumerate(RENDERERS)}


def compared(shown: Sequence[Float], wanted: Sequence[Float], talker: Talker) -> Array:
    """(n, 2) PSNR and SSIM in the mouth box of luma pictures (H, W)."""
    pictures, target = (np.clip(np.stack(each), 0, 255) for each in (shown, wanted))
    return np.stack([psnr(pictures, target, talker.window), ssim(pictures, target, talker.window)], 1)


def _compare(numbers: NDArray[np.int64], frames: FrameStore, talker: Talker) -> Array:
    """(n, renderers + 1, 2); last is fast against literal."""
    bench = _Bench(talker)
    drawn = [bench.drawn(frame) for frame in frames.take(numbers)]
    pairs = [(name, "recorded") for name in RENDERERS] + [("fast", "literal")]
    each = [compared([one[a] for one in drawn], [one[b] for one in drawn], talker) for a, b in pairs]
    return np.stack(each, 1)
