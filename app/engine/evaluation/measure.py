"""Everything that is measured of an avatar on recordings of its talker, and the bars that it should pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.engine.evaluation.comparison import Against, Comparison, compare, recorded, yardstick
from app.engine.evaluation.nose import NoseMotion, nose_motion, nose_patch, shifts
from app.engine.evaluation.opening import Lips, closed, closings
from app.engine.evaluation.reconstruction import reconstruct
from app.engine.evaluation.scores import CLOSED, OPEN, SPACES, Closure, Gain, Scores, TrajectoryRow
from app.engine.evaluation.speech import SHOWN, Drawn, Predict, Sentence, draw, louder, sentences
from app.engine.evaluation.talker import Talker, read
from app.engine.evaluation.training_sizes import SizePoint, training_sizes
from app.engine.metrics import OpeningScores, PictureScores, opening_scores, picture_scores, trajectory_scores
from app.engine.pack import digest
from app.engine.training.corpus import Corpus, Progress, gather, without
from app.engine.training.take import Refusal, Take, speaking
from app.engine.training.workspace import Workspace
from app.errors import InputError, TrainingFailed

Float = NDArray[np.float32]

STRANGER = 0.55
"""Residual of the tracker over the contrast of its template: a clip of more shows another face."""
LEADING = (12, 20)
"""Flow and texture modes of the smaller space that trajectories are scored in."""


@dataclass(frozen=True)
class Example:
    """One sentence with everything that a plot wants.

    Attributes:
        sentence: phones and trajectories.
        drawn: picture scores and openings.
    """

    sentence: Sentence
    drawn: Drawn


@dataclass(frozen=True)
class Test:
    """Scores, and the sentences that they are of."""

    scores: Scores
    examples: tuple[Example, ...]


@dataclass(frozen=True)
class Measured:
    """An avatar, measured.

    Attributes:
        tests: the open one first; one or two.
        scale: (K,) standard deviation of each coefficient in training.
        flow_count: how many of the coefficients are of flow.
        refused: takes and frames left out, with the reason.
        comparisons: of all models, the open test first; empty if none was wanted.
        sizes: of the curve over training sizes; empty if none were wanted.
        own_space: whether the common space comes from clips that the avatar has learnt from.
    """

    tests: tuple[Test, ...]
    scale: NDArray[np.float64]
    flow_count: int
    refused: tuple[Refusal, ...]
    comparisons: tuple[Comparison, ...] = ()
    sizes: tuple[SizePoint, ...] = ()
    own_space: bool = True


def measure(
    talker: Talker, takes: Sequence[Take], workspace: Workspace, *, models: Mapping[str, Predict] | None = None,
    gains: Sequence[float] = (), against: Against | None = None, workers: int = 0,
    progress: Progress = lambda *_: None,
) -> Measured:  # fmt: skip
    """Measure an avatar on takes of its talker.

    Args:
        talker: the avatar's.
        takes: what its talker says, with the phones.
        workspace: keeps what is finished.
        models: other trajectory models to score beside the avatar's own, by name, in its space.
        gains: see `Gain`.
        against: models and renderers to compare side by side.
        workers: processes; 0 for one a core.
        progress: see `Progress`.

    Raises:
        InputError: none of the takes shows the talker saying something.
        TrainingFailed: the takes cannot be read.
    """
    corpus = gather(takes, workspace, layout=talker.layout, common=talker.common, progress=progress, workers=workers)
    corpus = _without_strangers(corpus, talker)
    coefficients = read(corpus, talker.reader, workers=workers, progress=progress)
    said = sentences(corpus, coefficients, talker.trajectory.rest, talker.trajectory.predict)
    if not said:
        reasons = "; ".join(
            dict.fromkeys(f"{each.take}: {each.reason}" for each in corpus.refused if each.frame is None)
        )
        raise InputError(
            f"there is no clip to measure {talker.name} on" + (f" ({reasons})" if reasons else ""),
            advice="Give videos in which the avatar's own talker speaks, with their transcripts.",
        )
    learnt = np.array([_digest(take) in talker.trained_on for take in corpus.takes])
    owner = np.repeat(np.arange(len(corpus.takes)), np.diff(corpus.starts))
    tests = []
    parts: dict[str, list[Sentence]] = {}
    for name, wanted in ((OPEN, ~learnt), (CLOSED, learnt)):
        chosen = [each for each in said if wanted[owner[each.numbers[0]]]]
        if chosen:
            parts[name] = chosen
            kept = wanted[owner] & corpus.good
            tests.append(_test(name, talker, corpus, kept, owner, chosen, models or {}, gains, workers, progress))
    found = Measured(tuple(tests), talker.trajectory.scale, talker.modes.flow_count, corpus.refused)
    return found if against is None else _compared(found, parts, corpus, learnt[owner], talker, against, progress)


def _compared(
    found: Measured, parts: Mapping[str, Sequence[Sentence]], corpus: Corpus, learnt: NDArray[np.bool_],
    talker: Talker, against: Against, progress: Progress,
) -> Measured:  # fmt: skip
    by, own_space = yardstick(talker, corpus, learnt)
    rows = tuple(compare(name, said, corpus, talker, by, against, progress) for name, said in parts.items())
    sizes: tuple[SizePoint, ...] = ()
    if against.sizes:
        known, unheard = (recorded(parts.get(name, ()), corpus, by.space, against.hear) for name in (CLOSED, OPEN))
        sizes = training_sizes(known, unheard, talker.trajectory.rest, by, against, progress)
    return replace(found, comparisons=rows, sizes=sizes, own_space=own_space)


def _without_strangers(corpus: Corpus, talker: Talker) -> Corpus:
    """The corpus without takes in which the tracker finds the talker's eyes and nose nowhere: they are another's."""
    contrast = float(talker.layout.template.target.std())
    strangers = []
    for number in range(len(corpus.takes)):
        residual = corpus.residual[corpus.starts[number] : corpus.starts[number + 1]]
        if float(np.nanmedian(residual)) > STRANGER * contrast:
            strangers.append(number)
    left = [at for at, passage in enumerate(corpus.passages) if passage.take in strangers]
    reason = f"the face is not that of {talker.name}'s talker, or is seen very differently"
    refused = (Refusal(corpus.takes[number].name, None, reason) for number in strangers)
    return replace(without(corpus, left), refused=(*corpus.refused, *refused))


def _digest(take: Take) -> str:
    """SHA-256 of a take's file, as the manifest lists those that were learnt from."""
    try:
        return digest(take.video)
    except OSError as error:
        raise TrainingFailed(f"{take.video} cannot be read: {error.strerror or error}") from error


def _test(
    name: str, talker: Talker, corpus: Corpus, kept: NDArray[np.bool_], owner: NDArray[np.int64],
    said: Sequence[Sentence], models: Mapping[str, Predict], gains: Sequence[float], workers: int,
    progress: Progress,
) -> Test:  # fmt: skip
    counts = np.diff(corpus.starts)
    spoken = np.concatenate([speaking(take.phones, int(n)) for take, n in zip(corpus.takes, counts, strict=True)])
    lips = Lips.of(talker.morphable, talker.window)
    again = reconstruct(corpus, talker, np.flatnonzero(kept), spoken, workers=workers, progress=progress)
    drawn = draw(said, corpus, talker, lips, workers=workers, progress=progress)
    rows = [row for space in SPACES for row in _trajectories(talker, said, space, models)]
    rest = talker.trajectory.rest
    louder_ones = []
    for gain in gains:
        changed = [louder(each, rest, gain) for each in said]
        shown = draw(changed, corpus, talker, lips, workers=workers, progress=progress)
        louder_ones.append(_gain(gain, talker, changed, shown))
    if gains:
        louder_ones.insert(0, _gain(1.0, talker, said, drawn))
    scores = Scores(
        test=name, clips=len({int(owner[each.numbers[0]]) for each in said}), sentences=len(said),
        frames=int(kept.sum()), speech_frames=sum(int(each.speech.sum()) for each in said), trajectories=tuple(rows),
        reconstruction=again,
        speech={each: _pictures(said, drawn, place) for place, each in enumerate(SHOWN)},
        opening=_opening(said, drawn), closure=_closure(said, drawn, talker.trajectory.lead),
        gains=tuple(louder_ones), nose=_nose(corpus, kept, owner, talker),
    )  # fmt: skip
    return Test(scores, tuple(Example(each, shown) for each, shown in zip(said, drawn, strict=True)))


def _trajectories(
    talker: Talker, said: Sequence[Sentence], space: str, models: Mapping[str, Predict]
) -> list[TrajectoryRow]:
    flow = talker.modes.flow_count
    chosen = np.arange(talker.modes.count)
    if space != SPACES[0]:
        chosen = np.r_[0 : min(LEADING[0], flow), flow : min(flow + LEADING[1], talker.modes.count)]
    predicted = {"avatar": [each.predicted for each in said]}
    for name, predict in models.items():
        predicted[name] = [predict(each.phones, len(each.numbers)) for each in said]
    for name, still in (("rest", talker.trajectory.rest), ("mean", talker.trajectory.offset)):
        predicted[name] = [np.broadcast_to(still, each.true.shape) for each in said]
    true = [each.true[each.counted][:, chosen] for each in said]
    rows = []
    for name, given in predicted.items():
        shown = [one[each.counted][:, chosen] for one, each in zip(given, said, strict=True)]
        rows.append(TrajectoryRow(name, space, trajectory_scores(shown, true, talker.trajectory.scale[chosen])))
    return rows


def _pictures(said: Sequence[Sentence], drawn: Sequence[Drawn], place: int) -> PictureScores | None:
    found = np.concatenate([shown.scores[each.speech, place] for each, shown in zip(said, drawn, strict=True)])
    return picture_scores(found[:, 0], found[:, 1])


def _opening(said: Sequence[Sentence], drawn: Sequence[Drawn]) -> OpeningScores | None:
    each = list(zip(said, drawn, strict=True))
    return opening_scores(
        [shown.shown[one.counted] for one, shown in each], [shown.recorded[one.counted] for one, shown in each]
    )


def _closure(said: Sequence[Sentence], drawn: Sequence[Drawn], lead: float) -> Closure | None:
    recorded: list[bool] = []
    predicted: list[bool] = []
    for one, shown in zip(said, drawn, strict=True):
        when = [stretch for stretch in closings(one.phones, len(one.numbers), lead) if one.counted[stretch].all()]
        recorded += closed(shown.recorded, when)
        predicted += closed(shown.shown, when)
    return Closure(float(np.mean(recorded)), float(np.mean(predicted)), len(recorded)) if recorded else None


def _gain(gain: float, talker: Talker, said: Sequence[Sentence], drawn: Sequence[Drawn]) -> Gain:
    row = _trajectories(talker, said, SPACES[0], {})[0]
    opening, closure = _opening(said, drawn), _closure(said, drawn, talker.trajectory.lead)
    pictures = _pictures(said, drawn, 0)
    assert pictures is not None
    return Gain(
        gain,
        opening.amplitude if opening else None,
        row.scores.error_weighted,
        pictures.psnr,
        closure.shown if closure else None,
    )


def _nose(corpus: Corpus, kept: NDArray[np.bool_], owner: NDArray[np.int64], talker: Talker) -> NoseMotion:
    crop = corpus.crop
    rows, columns = nose_patch(crop, talker.layout.side)
    moved = []
    for number in range(len(corpus.takes)):
        chosen = np.flatnonzero(kept & (owner == number))
        if len(chosen):
            patches = [
                block[:, : crop.width * crop.height].reshape(-1, crop.height, crop.width)[:, rows, columns]
                for block in corpus.frames.blocks(chosen)
            ]
            moved.append(shifts(np.concatenate(patches).astype(np.float32)))
    return nose_motion(moved)
