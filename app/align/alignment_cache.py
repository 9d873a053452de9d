"""Alignments that were found before, a small file for each, so that an interrupted run goes on where it was."""

from __future__ import annotations

import hashlib
import json
import os
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.align.aligner import Alignment
from app.align.clips import Clip
from app.errors import InputError
from app.speech import PHONES, Phone, Word

VERSION = 1  # of the files and of what decides the times in them: the reading of the sound, pauses, pronunciations


@dataclass(frozen=True, slots=True)
class Entry:
    """What is kept of a clip.

    Attributes:
        alignment: on the video's clock.
        start: of the sound on the video's clock, seconds, as in `app.align.clip_sound.ClipSound`.
        lost: seconds of sound missing, as there.
    """

    alignment: Alignment
    start: float
    lost: float


class AlignmentCache:
    """Entries by the content of a clip: the same video and transcript under another name are the same entry.

    What an aligner is made with (a lexicon) is not part of the key: another lexicon needs another folder.

    Args:
        folder: made if it is missing; nothing else needs to be known of it, and any file in it may be deleted.
    """

    def __init__(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder} cannot be used to keep alignments: {error.strerror}") from error
        self._folder = folder

    def key(self, clip: Clip, aligner: str) -> str:
        """Of a clip that has a transcript; `aligner` is its name, "" if none is needed. Raises OSError."""
        assert clip.transcript is not None
        digest = hashlib.sha256(f"mary alignment {VERSION}\0{aligner}\0".encode())
        if clip.text is None:
            said, kind = clip.transcript.read_bytes(), clip.transcript.suffix.lower()
        else:
            said, kind = clip.text.encode(), "line"
        digest.update(f"{kind}\0{len(said)}\0".encode() + said)
        with clip.video.open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
        return digest.hexdigest()

    def read(self, key: str) -> Entry | None:
        """None if there is none, or none that can be read."""
        try:
            return _entry(json.loads((self._folder / f"{key}.json").read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def write(self, key: str, entry: Entry) -> None:
        """Keep an entry; a full disk costs only the time that it would have saved."""
        alignment = entry.alignment
        content = {
            "start": entry.start,
            "lost": entry.lost,
            "confidence": alignment.confidence,
            "guessed": alignment.guessed,
            "words": [(word.text, word.start, word.end) for word in alignment.words],
            "phones": [(phone.symbol, phone.start, phone.end) for phone in alignment.phones],
        }
        beside = self._folder / f"{key}.{os.getpid()}.{threading.get_ident()}.part"
        try:
            beside.write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")
            beside.replace(self._folder / f"{key}.json")
        except OSError:
            with suppress(OSError):
                beside.unlink()


def _entry(content: Any) -> Entry:
    phones = tuple(Phone(str(symbol), float(start), float(end)) for symbol, start, end in content["phones"])
    words = tuple(Word(str(text), float(start), float(end)) for text, start, end in content["words"])
    guessed = tuple(str(text) for text in content["guessed"])
    if not phones or any(phone.symbol not in PHONES for phone in phones):
        raise ValueError("no phones")
    alignment = Alignment(phones, words, guessed, float(content["confidence"]))
    return Entry(alignment, float(content["start"]), float(content["lost"]))
