"""What the engines ask of espeak-ng: sound with the times of its phonemes, and the IPA of texts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import MissingExtra, SpeechFailed
from app.worker import Worker, WorkerFailed

PACE = 175  # words a minute at speed 1: espeak's own default


@dataclass(frozen=True, slots=True)
class EspeakVoice:
    """A voice as espeak lists it: its identifier, its name, its language (lower case) and its sex."""

    identifier: str
    name: str
    language: str
    sex: str


@dataclass(frozen=True, slots=True)
class Timed:
    """One phoneme: IPA (empty: a pause), its first sample, and where in the text the word begins that it belongs to."""

    ipa: str
    sample: int
    position: int


@dataclass(frozen=True, slots=True)
class Uttered:
    """Sound, float32 of shape (n,), its rate and its phonemes in order."""

    samples: NDArray[np.float32]
    rate: int
    phonemes: tuple[Timed, ...]


class EspeakProcess:
    """espeak-ng in a process of its own (`app.tts.espeak_worker`), which starts when it is first asked.

    May be used from several threads; they wait for each other.

    Args:
        engine: named in errors, and the extra that brings the library.
        seconds: time limit of one call.
    """

    def __init__(self, engine: str, seconds: float) -> None:
        self._engine = engine
        self.seconds = seconds
        self._worker = Worker("app.tts.espeak_worker")

    @property
    def pid(self) -> int | None:
        """Number of the process; None if there is none."""
        return self._worker.pid

    def voices(self) -> tuple[EspeakVoice, ...]:
        """All voices of all languages, then the variants, whose language is ``variant``.

        Raises:
            MissingExtra: as everything here, if the library is not installed.
            SpeechFailed: as everything here, if the process dies or takes too long.
        """
        answer, _ = self._ask({"task": "voices"})
        return tuple(EspeakVoice(*voice) for voice in answer)

    def speak(self, text: str, voice: str, speed: float, *, mnemonics: bool = False) -> Uttered:
        """Speak a text by the voice of this identifier; `mnemonics`: ``[[...]]`` in it holds phonemes."""
        question = {"task": "speak", "text": text, "voice": voice, "mnemonics": mnemonics}
        answer, sound = self._ask({**question, "pace": round(PACE * speed)})
        phonemes: list[Timed] = []
        position = -1
        for kind, what, sample in answer["events"]:
            if kind == "word":
                position = what
            else:
                phonemes.append(Timed(what, sample, position))
        samples = np.frombuffer(sound, np.int16).astype(np.float32) / np.float32(32768)
        return Uttered(samples, answer["rate"], tuple(phonemes))

    def ipa(self, texts: Sequence[str], voice: str) -> list[str]:
        """IPA of each text with stress marks, its words divided by spaces; empty if nothing of it is said."""
        answer, _ = self._ask({"task": "ipa", "texts": list(texts), "voice": voice})
        return list(answer)

    def close(self) -> None:
        """End the process; asking again starts another."""
        self._worker.close()

    def _ask(self, question: dict[str, Any]) -> tuple[Any, bytes]:
        try:
            answer, data = self._worker.ask(question, seconds=self.seconds)
        except WorkerFailed as error:
            raise SpeechFailed(f"speech engine {self._engine}: espeak-ng: {error}", advice="Try again.") from error
        if answer is None:
            raise MissingExtra(
                f"speech engine {self._engine} needs espeak-ng, which is not installed",
                advice=f"pip install 'mary[{self._engine}]', or install the system's libespeak-ng1.",
                field="speech.engine",
            )
        return answer, data
