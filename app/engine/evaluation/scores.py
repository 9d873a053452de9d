"""What is measured of an avatar in one test, and the bars that it should pass."""

from __future__ import annotations

from dataclasses import dataclass

from app.engine.evaluation.nose import NoseMotion
from app.engine.evaluation.reconstruction import Reconstruction
from app.engine.metrics import OpeningScores, PictureScores, TrajectoryScores

SPACES = ("all modes", "leading modes")
OPEN, CLOSED = "open", "closed"


@dataclass(frozen=True, slots=True)
class TrajectoryRow:
    """One model in one space.

    Attributes:
        model: its name; "rest" and "mean" are mouths that do not move.
        space: one of `SPACES`.
        scores: against the analysed trajectories.
    """

    model: str
    space: str
    scores: TrajectoryScores


@dataclass(frozen=True, slots=True)
class Closure:
    """How often lips close where they should.

    Attributes:
        recorded, shown: share of the phones at which they do.
        phones: how many.
    """

    recorded: float
    shown: float
    phones: int


@dataclass(frozen=True, slots=True)
class Gain:
    """The predicted mouth's motion made larger.

    Attributes:
        gain: of its deviation from rest; 1 is the model itself.
        amplitude: of the opening.
        error_weighted: AMSE weighted by variance, all modes.
        psnr: of the pictures, speech, dB.
        closure: share of closed lips where they should be.
    """

    gain: float
    amplitude: float | None
    error_weighted: float
    psnr: float
    closure: float | None


@dataclass(frozen=True, slots=True)
class Bar:
    """What a figure should reach.

    Attributes:
        figure: what it is.
        value: measured; None if it could not be.
        least, most: between which it should lie; None: no limit.
    """

    figure: str
    value: float | None
    least: float | None = None
    most: float | None = None

    @property
    def met(self) -> bool:
        """Whether it does."""
        if self.value is None:
            return False
        return (self.least is None or self.value >= self.least) and (self.most is None or self.value <= self.most)


@dataclass(frozen=True)
class Scores:
    """One test: what was measured on clips that the avatar has learnt from (closed) or has not (open).

    Attributes:
        test: `OPEN` or `CLOSED`.
        clips, sentences, frames, speech_frames: how many were measured.
        trajectories: of the avatar and of the baselines, in both spaces.
        reconstruction: of analysed frames.
        speech: of each of `app.engine.evaluation.speech.SHOWN`, pictures in speech.
        opening: predicted against recorded.
        closure: at /m b p/.
        gains: see `Gain`.
        nose: what stabilisation leaves over.
    """

    test: str
    clips: int
    sentences: int
    frames: int
    speech_frames: int
    trajectories: tuple[TrajectoryRow, ...]
    reconstruction: Reconstruction
    speech: dict[str, PictureScores | None]
    opening: OpeningScores | None
    closure: Closure | None
    gains: tuple[Gain, ...]
    nose: NoseMotion

    def bars(self) -> tuple[Bar, ...]:
        """The bars, with what was measured."""
        drawn, said = self.reconstruction.speech, self.speech["predicted"]
        serving, literal = drawn["serving"], drawn["literal"]
        both = self.reconstruction.fast_against_literal
        opening = self.opening
        return (
            Bar("serving model, dB", serving.psnr if serving else None, least=39.5),
            Bar("serving model, SSIM", serving.ssim if serving else None, least=0.97),
            Bar("literal model, dB", literal.psnr if literal else None, least=37.0),
            Bar("fast form minus literal, dB", self.reconstruction.fast_minus_literal, least=-0.3),
            Bar("fast form against literal, dB", both.psnr if both else None, least=42.0),
            Bar("rendered speech, dB", said.psnr if said else None, least=31.8),
            Bar("lag of the opening, frames", float(opening.lag) if opening else None, least=0, most=1),
            Bar("amplitude of the opening", opening.amplitude if opening else None, least=0.85, most=1.1),
            Bar("motion of the nose, 95 %, px", self.nose.p95, most=0.7),
        )
