"""What a speech engine is: the protocol, its voices, and how a voice is chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from app.align.dictionary import NO_LEXICON, Lexicon
from app.errors import ConfigError, MissingExtra, NotFound
from app.speech import Speech


@dataclass(frozen=True, slots=True)
class Voice:
    """One voice of an engine.

    Attributes:
        id: what callers name it by; unique within its engine.
        name: for people.
        language: BCP 47, e.g. ``en-US``.
        sex: ``female``, ``male`` or ``""``.
        rate: samples a second of its sound.
        licence: SPDX identifier of the voice's licence.
        engine: name of the engine.
        installed: whether it can speak now.
        missing: what to install if it cannot, otherwise ``""``.
    """

    id: str
    name: str
    language: str
    sex: str
    rate: int
    licence: str
    engine: str
    installed: bool = True
    missing: str = ""


@runtime_checkable
class SpeechEngine(Protocol):
    """Turns text into sound with phones. Everything here blocks; `speak` may be called from several threads at once.

    A class that has settings holds a pydantic model `Options` and is made with one; see `app.plugins`.

    Attributes:
        name: what it is chosen by.
        pronounces: whether it says the words of a lexicon as the lexicon has them.
    """

    name: str
    pronounces: bool

    def voices(self) -> tuple[Voice, ...]:
        """All voices, the default first. Must be quick: it is asked before `warm_up`."""
        ...

    def warm_up(self) -> None:
        """Load what speaking needs. May be called again; then it does nothing."""
        ...

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        """Speak one sentence or clause.

        Args:
            text: cleaned text (`app.tts.text.clean`), one to a few hundred characters.
            voice: a voice's id; empty means the default voice.
            speed: 1 is the voice's own pace, 2 is twice as fast.
            lexicon: how some words of the text are to be said; an engine that cannot (`pronounces`) disregards it.

        Returns:
            sound with phones and words; an engine that does not know them leaves both empty, and they are found by an
            aligner (`app.tts.timed`).

        Raises:
            NothingToSay: the text makes no sound.
            NotFound: no such voice.
            MissingExtra: the voice exists but is not installed.
            SpeechFailed: the engine failed.
        """
        ...

    def close(self) -> None:
        """End processes and connections. May be called again."""
        ...


def choose_voice(engine: SpeechEngine, requested: str = "", preferred: str = "") -> Voice:
    """The voice to speak with.

    Args:
        engine: whose voices.
        requested: what the caller asked for; must exist and be installed. Empty: nothing asked for.
        preferred: used if the engine has it installed (an avatar's default voice, which another engine may not know);
            otherwise the engine's first installed voice.

    Raises:
        NotFound: `requested` is unknown, or the engine has no voice at all.
        MissingExtra: `requested` is known but not installed; the advice names what is missing.
    """
    voices = engine.voices()
    if requested:
        found = next((voice for voice in voices if voice.id == requested), None)
        if found is None:
            raise NotFound(
                f"speech engine {engine.name} has no voice {requested!r}",
                field="voice",
                advice=f"It has: {_names(voices)}.",
            )
        if not found.installed:
            installed = _names([voice for voice in voices if voice.installed]) or "none"
            raise MissingExtra(
                f"voice {found.id} of speech engine {engine.name} is not installed",
                field="voice",
                advice=f"Install {found.missing or 'it'}. Installed voices: {installed}.",
            )
        return found
    usable = [voice for voice in voices if voice.installed] or list(voices)
    if not usable:
        raise NotFound(f"speech engine {engine.name} has no voices", field="voice")
    return next((voice for voice in usable if voice.id == preferred), usable[0])


def check_configured(engine: SpeechEngine, voice: str) -> None:
    """Refuse a voice in the settings that the engine cannot speak with; empty means that none is configured.

    Raises:
        ConfigError: it is unknown or not installed; the advice names the voices there are.
    """
    if not voice:
        return
    try:
        choose_voice(engine, voice)
    except (NotFound, MissingExtra) as error:
        raise ConfigError(f"speech.voice: {error.message}", field="speech.voice", advice=error.advice) from error


def _names(voices: Sequence[Voice]) -> str:
    return ", ".join(voice.id for voice in voices)
