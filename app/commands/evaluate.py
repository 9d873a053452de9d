"""`mary evaluate`: how well an avatar says what its talker was recorded saying."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from app.align.clips import find_clips
from app.commands.long_work import LongWork, shown
from app.commands.takes import hear, spoken_takes
from app.errors import InputError
from app.evaluation.evaluation import evaluate
from app.evaluation.tables import tables
from app.evaluation.write_evaluation import check_writable, write_figures, write_folder

STEPS = {
    "listening": 5.0, "following the face": 4.0, "cutting out the mouth": 3.0, "reading": 13.0, "reconstruction": 8.0,
    "drawing": 30.0, "comparing": 20.0,
}  # fmt: skip
"""Seconds of each step for 28 clips of three seconds on two cores: what the time left is told by."""


def run(
    inputs: Sequence[Path],
    transcripts: Sequence[Path],
    avatar: Path,
    *,
    figures: Path | None,
    output: Path | None,
    gains: str,
    models: Sequence[str],
    renderers: Sequence[str],
    sizes: str,
    seed: int,
    aligner: str,
    workers: int,
    out: Console,
    err: Console,
) -> None:
    """Measure an avatar, showing progress, and print what was found.

    Args:
        inputs: videos of its talker, or folders of them.
        transcripts: files or folders; none: beside the videos.
        avatar: folder of the pack.
        figures: JSON file to write, if any.
        output: folder to write figures and plots to, if any.
        gains: numbers with commas between; see `app.engine.evaluation.scores.Gain`.
        models: trajectory models to compare; none: all that the avatar has.
        renderers: to compare.
        sizes: numbers of sentences with commas between, to train the models on anew; see
            `app.engine.evaluation.training_sizes`.
        seed: of that training.
        aligner: its name.
        workers: processes; 0 for one a core.
        out, err: where tables and progress go.

    Raises:
        InputError: nothing can be measured on these clips, or a place cannot be written to.
        BadPack: the avatar is damaged.
    """
    larger, parts = _numbers(gains), _counts(sizes)
    check_writable(output, figures)
    steps = STEPS | {"training anew": 60.0 * len(parts)}
    with shown(err, LongWork(steps)) as work:
        takes, aligned = spoken_takes(
            find_clips(inputs, transcripts), aligner=aligner, cache=None, workers=workers,
            progress=lambda share: work.tell("listening", share),
        )  # fmt: skip
        found = evaluate(
            avatar, takes, aligned, gains=larger, models=models or None, renderers=renderers, sizes=parts, seed=seed,
            hear=hear, workers=workers, progress=work.tell,
        )  # fmt: skip
    for each in tables(found):  # before anything is written: what was measured is not lost if that fails
        out.print(each)
        out.print()
    if figures is not None:
        write_figures(found, figures)
    if output is not None:
        write_folder(found, output)


def _numbers(text: str) -> list[float]:
    try:
        gains = [float(number) for number in text.split(",") if number.strip()]
    except ValueError as error:
        raise InputError(f"--gains takes numbers, not {text!r}", field="gains", advice="--gains 1.1,1.2") from error
    if any(not 0 < gain <= 4 for gain in gains):
        raise InputError("--gains takes numbers above 0 and up to 4", field="gains", advice="--gains 1.1,1.2")
    return gains


def _counts(text: str) -> list[int]:
    try:
        counts = [int(number) for number in text.split(",") if number.strip()]
    except ValueError as error:
        raise InputError(
            f"--sizes takes whole numbers, not {text!r}", field="sizes", advice="--sizes 50,100"
        ) from error
    if any(count < 1 for count in counts):
        raise InputError("--sizes takes numbers above 0", field="sizes", advice="--sizes 50,100")
    return counts
