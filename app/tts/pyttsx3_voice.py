"""The system's own voices through pyttsx3: eSpeak NG on Linux, what macOS and Windows bring elsewhere.

pyttsx3 tells no times of phones, so its sound goes to the aligner. It runs in a process of its own
(`app.tts.pyttsx3_worker`), which is ended when it hangs.
"""

from __future__ import annotations

import tempfile
import threading
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from app.align.dictionary import NO_LEXICON, Lexicon
from app.align.sound_file import read_sound
from app.errors import InputError, MissingExtra, NotFound, NothingToSay, SpeechFailed
from app.speech import Speech
from app.tts.engine import Voice
from app.tts.espeak import LICENCE, RATE, bcp47
from app.tts.text import speakable
from app.worker import Worker, WorkerFailed

_MISSING = "espeak-ng: pip install 'mary[espeak]', or apt-get install libespeak-ng1"


class Pyttsx3Engine:
    """See `app.tts.engine.SpeechEngine`. No phone times; the lexicon is not followed."""

    class Options(BaseModel):
        """Attributes: see docs/speech.md."""

        model_config = ConfigDict(extra="forbid", frozen=True)

        seconds: float = Field(default=10.0, gt=0)  # time limit of one call

    name = "pyttsx3"
    pronounces = False

    def __init__(self, options: Options | None = None) -> None:
        self.seconds = (options or self.Options()).seconds
        self._worker = Worker("app.tts.pyttsx3_worker")
        self._lock = threading.Lock()
        self._voices: tuple[Voice, ...] = ()

    def voices(self) -> tuple[Voice, ...]:
        try:
            return self._known()
        except MissingExtra:
            name = "English (America)"
            return (
                Voice("gmw/en-us", name, "en-US", "male", RATE, LICENCE, self.name, installed=False, missing=_MISSING),
            )

    def warm_up(self) -> None:
        """Start the process and read its voices."""
        self._known()

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        del lexicon  # the system's voices take no phonemes that all of them understand
        known = [each.id for each in self._known()]
        if voice and voice not in known:
            raise NotFound(
                f"speech engine pyttsx3 has no voice {voice!r}", field="voice", advice=f"It has: {', '.join(known)}."
            )
        plain = "".join(letter if letter.isprintable() else " " for letter in text)  # controls would be commands
        if not speakable(plain):
            raise NothingToSay("the text has nothing to say", field="text")
        with tempfile.TemporaryDirectory(prefix="mary-pyttsx3-") as folder:
            path = Path(folder) / "speech.wav"
            self._ask({"task": "speak", "text": plain, "voice": voice or known[0], "speed": speed, "path": str(path)})
            if not path.exists():
                raise self._failed("it wrote no sound")
            try:
                samples, rate = read_sound(path, name="its sound")
            except InputError as error:
                raise self._failed(error.message) from error
        return Speech(samples, rate, phones=(), words=())

    def close(self) -> None:
        """End the process; speaking again starts another."""
        self._worker.close()

    @property
    def process(self) -> int | None:
        """Number of the process in which pyttsx3 runs; None if there is none."""
        return self._worker.pid

    def _known(self) -> tuple[Voice, ...]:
        with self._lock:
            if not self._voices:
                answer = self._ask({"task": "voices"})
                espeak = answer["driver"] == "espeak"
                voices = [self._voice(*voice, espeak=espeak) for voice in answer["voices"]]
                english = [voice for voice in voices if voice.language.split("-")[0] in ("en", "")]
                if not english:
                    raise self._failed("the system has no English voice", "Install one.")
                preferred = "gmw/en-us" if espeak else answer["voice"]
                self._voices = tuple(sorted(english, key=lambda voice: voice.id != preferred))
            return self._voices

    def _voice(self, key: str, name: str, languages: list[str], sex: str, *, espeak: bool) -> Voice:
        language = bcp47(languages[0].replace("_", "-").lower()) if languages else ""
        return Voice(key, name, language, sex, RATE, LICENCE if espeak else "", self.name)

    def _ask(self, question: dict[str, Any]) -> Any:
        try:
            answer, _ = self._worker.ask(question, seconds=self.seconds)
        except WorkerFailed as error:
            raise self._failed(str(error)) from error
        if answer is None:
            raise MissingExtra(
                "speech engine pyttsx3 needs espeak-ng, which is not installed",
                advice="pip install 'mary[espeak]', or apt-get install libespeak-ng1.",
                field="speech.engine",
            )
        return answer

    def _failed(self, message: str, advice: str = "Try again.") -> SpeechFailed:
        return SpeechFailed(f"speech engine {self.name}: {message}", advice=advice)
