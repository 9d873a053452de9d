"""An aligner that looks up what another one has found: TextGrid files, as the Montreal Forced Aligner leaves them.

An aligner is given sound and text, not a file's name. So the file is found by what is said in it, then by how long it
is, and if that leaves several, by the sound beside it.
"""

from __future__ import annotations

import threading
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from app.align.aligner import Alignment, assemble, checked
from app.align.dictionary import NO_LEXICON, Lexicon
from app.align.phoneset import Sound
from app.align.sound_file import read_sound
from app.align.transcript import MOST_BYTES, Transcript, decoded, read_transcript
from app.errors import AlignmentFailed, ConfigError, InputError, MaryError, NothingToSay
from app.speech import SILENCE, Word

TEXTS = (".lab", ".txt")  # beside a sound: what is said in it
SOUNDS = (".wav", ".flac", ".mp3", ".ogg")
TOLERANCE = 0.05  # seconds between the end of a TextGrid and that of its sound; programs round differently
SAME = 0.002  # 2 ms: as long as each other
SAME_SAMPLE = 1e-3  # a few steps of 16 bits


class TextGridOptions(BaseModel):
    """Options of the aligner.

    Attributes:
        folder: of the TextGrid files, with all folders inside.
        corpus: folder of the sounds and of the texts (``.lab``, ``.txt``) that they were made of, in folders of the
            same names; the same folder by default. Neither has to be there.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    folder: Path
    corpus: Path | None = None


@dataclass(frozen=True, slots=True)
class _Entry:
    """One file of the folder.

    Attributes:
        path: of the TextGrid.
        stamp: what changes when it or its text does.
        said: the texts it is found by, letters and digits only.
        duration: seconds.
        problem: why it cannot be used, if it cannot.
    """

    path: Path
    stamp: tuple[int, ...]
    said: frozenset[str] = frozenset()
    duration: float = 0.0
    problem: str = ""


class TextGridAligner:
    """See `app.align.aligner.Aligner`. Times are taken at their word: the confidence is 1, nothing is guessed.

    Files that come, change or go while it is in use are noticed.
    """

    name = "textgrid"
    Options = TextGridOptions

    def __init__(self, options: TextGridOptions) -> None:
        self._folder = options.folder
        self._corpus = options.corpus or options.folder
        self._lock = threading.Lock()
        self._entries: dict[Path, _Entry] = {}
        for key, folder in (("folder", options.folder), ("corpus", self._corpus)):
            if not folder.is_dir():
                field = f"align.aligners.textgrid.{key}"
                raise ConfigError(f"{field}: there is no folder {folder}", field=field)

    def align(
        self,
        samples: NDArray[np.float32],
        rate: int,
        text: str,
        *,
        lexicon: Lexicon = NO_LEXICON,  # noqa: ARG002 (how it is said has been decided)
    ) -> Alignment:
        checked(samples, rate, text)
        if not _letters(text):
            raise NothingToSay("the transcript has no word that sounds", field="text")
        path = self._found(samples, rate, text)
        try:
            transcript = read_transcript(path)
        except InputError as error:
            raise self._failed(error.message, error.advice) from error
        duration = len(samples) / rate
        sounds = [Sound(phone.symbol, phone.start, phone.end) for phone in transcript.phones or ()]
        phones = assemble(sounds, (), duration).phones
        if all(phone.symbol == SILENCE for phone in phones):
            raise self._failed(f"{path.name} has no phone", "Align that recording again.")
        return Alignment(phones, tuple(_words(text, transcript, duration)), (), 1.0)

    def _found(self, samples: NDArray[np.float32], rate: int, text: str) -> Path:
        """The file of this sound and text. Raises AlignmentFailed."""
        entries = self._read()
        letters, duration = _letters(text), len(samples) / rate
        saying = [entry for entry in entries if letters in entry.said]
        if not saying:
            problems = [entry.problem for entry in entries if entry.problem]
            more = f"; {len(problems)} cannot be used, the first because: {problems[0]}" if problems else ""
            raise self._failed(
                f"none of {len(entries)} TextGrid files in {self._folder} says “{_excerpt(text)}”{more}",
                "Put NAME.TextGrid there; if its words are spelt in another way, the text as NAME.lab beside it.",
            )
        fitting = [entry for entry in saying if abs(entry.duration - duration) <= TOLERANCE]
        if not fitting:
            lengths = ", ".join(f"{entry.path.name} {entry.duration:.2f} s" for entry in saying[:3])
            raise self._failed(
                f"“{_excerpt(text)}” is there, but the sound is {duration:.2f} s long, {lengths}",
                "Is it the recording that was aligned, uncut?",
            )
        exact = [entry for entry in fitting if abs(entry.duration - duration) <= SAME]
        left = exact or fitting
        if len(left) > 1:
            left = [entry for entry in left if self._sounds_alike(entry.path, samples, rate)]
        if len(left) != 1:
            names = ", ".join(entry.path.name for entry in (left or exact or fitting)[:4])
            raise self._failed(
                f"“{_excerpt(text)}” is said for as long in several files: {names}",
                "Put the sounds beside them under the same names, or in the folder “corpus”.",
            )
        return left[0].path

    def _read(self) -> list[_Entry]:
        """The files there are now; only new and changed ones are opened."""
        with self._lock:
            paths = sorted(path for path in self._folder.rglob("*") if path.suffix.lower() == ".textgrid")
            known, self._entries = self._entries, {}
            for path in paths:
                texts = list(self._beside(path, TEXTS))
                stamp = tuple(_stamp([path, *texts]))
                entry = known.get(path)
                self._entries[path] = entry if entry and entry.stamp == stamp else _entry(path, texts, stamp)
            return list(self._entries.values())

    def _beside(self, path: Path, endings: Sequence[str]) -> Iterator[Path]:
        for folder in dict.fromkeys((self._folder, self._corpus)):
            for ending in endings:
                beside = (folder / path.relative_to(self._folder)).with_suffix(ending)
                if beside.is_file():
                    yield beside

    def _sounds_alike(self, path: Path, samples: NDArray[np.float32], rate: int) -> bool:
        for sound in self._beside(path, SOUNDS):
            try:
                own, own_rate = read_sound(sound)
            except MaryError:
                continue
            if own_rate == rate and own.shape == samples.shape and np.abs(own - samples).max() < SAME_SAMPLE:
                return True
        return False

    def _failed(self, message: str, advice: str) -> AlignmentFailed:
        return AlignmentFailed(f"aligner {self.name}: {message}", advice=advice)


def _entry(path: Path, texts: Iterable[Path], stamp: tuple[int, ...]) -> _Entry:
    try:
        transcript = read_transcript(path)
        if not transcript.phones:
            raise InputError(f"{path.name}: no tier is called “phones”")
        said = {transcript.text, *(decoded(text.read_bytes()[:MOST_BYTES]) for text in texts)}
    except InputError as error:
        return _Entry(path, stamp, problem=error.message)
    except OSError as error:
        return _Entry(path, stamp, problem=f"{path.name}: {error.strerror or error}")
    return _Entry(path, stamp, frozenset(map(_letters, said)), transcript.phones[-1].end)


def _stamp(paths: Iterable[Path]) -> Iterator[int]:
    for path in paths:
        try:
            about = path.stat()
        except OSError:  # it is just being replaced
            yield -1
        else:
            yield about.st_mtime_ns
            yield about.st_size


# --- words ------------------------------------------------------------------------------------------------------------


def _words(text: str, transcript: Transcript, duration: float) -> Iterator[Word]:
    """The words as they are written in the text, with the times of those in the file."""
    written = [word for word in text.split() if _letters(word)]
    at = 0.0
    for word, said in zip(written, _said(written, transcript.words or ()), strict=True):
        if said:
            start, end = max(at, said[0].start), min(said[-1].end, duration)
            if start < end:
                yield Word(word, start, end)
                at = end


def _said(written: Sequence[str], timed: Sequence[Word]) -> list[list[Word]]:
    """For each written word those of the file that say it: none, one, or the parts of a word with a hyphen."""
    ours, theirs = [_letters(word) for word in written], [_letters(word.text) for word in timed]
    if "".join(ours) == "".join(theirs):  # divided in other places perhaps
        spans = _spans(theirs)
        return [
            [timed[number] for number, (first, last) in enumerate(spans) if first < end and last > start]
            for start, end in _spans(ours)
        ]
    said: list[list[Word]] = [[] for _ in written]  # words that the aligner does not know are <unk>
    for block in SequenceMatcher(None, ours, theirs, autojunk=False).get_matching_blocks():
        for at in range(block.size):
            said[block.a + at] = [timed[block.b + at]]
    return said


def _spans(words: Sequence[str]) -> list[tuple[int, int]]:
    edges = [0]
    for word in words:
        edges.append(edges[-1] + len(word))
    return list(pairwise(edges))


def _letters(text: str) -> str:
    """What two spellings of a text have in common: letters and digits, without case."""
    return "".join(filter(str.isalnum, unicodedata.normalize("NFKC", text).casefold()))


def _excerpt(text: str, longest: int = 60) -> str:
    line = " ".join(text.split())
    return line if len(line) <= longest else line[: longest - 1].rstrip() + "…"
