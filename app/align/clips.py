"""The clips of a corpus: which videos there are, and which transcript belongs to each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Clip:
    """A video of somebody who speaks, and what they say.

    Attributes:
        name: unique in its corpus: the path from the folder that all videos have in common, "/" between folders, without
            the suffix (with it if two videos would have the same name otherwise).
        video: the file.
        transcript: the file that says what is said; None if none was found.
        text: what is said, if the transcript is a list with a line for each clip; None: the transcript is all its own.
    """

    name: str
    video: Path
    transcript: Path | None
    text: str | None = None


def find_clips(inputs: Sequence[Path], transcripts: Sequence[Path] = ()) -> list[Clip]:
    """The videos among files and folders, each with its transcript."""
    raise NotImplementedError
