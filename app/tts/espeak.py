"""espeak-ng: a robotic voice that is always there at once, and knows to the sample when each of its phones begins.

The library is under the GPL (version 3 or later) and therefore an extra. It runs in a process of its own
(`app.tts.espeak_process`).
"""

from __future__ import annotations

import threading
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from app.align.dictionary import NO_LEXICON, Lexicon, Pronunciation, folded
from app.align.phoneset import Sound, Unit, merge, phones_of
from app.errors import ConfigError, MissingExtra, NotFound, NothingToSay
from app.speech import PHONES, SILENCE, Phone, Speech
from app.tts.engine import Voice
from app.tts.espeak_process import EspeakProcess, EspeakVoice, Timed, Uttered
from app.tts.take import words_of
from app.tts.words import assign, parts

RATE = 22_050  # samples a second
DEFAULT = "en-us"
LICENCE = "GPL-3.0-or-later"
EDGE = 0.060  # 60 ms of silence at both ends; espeak itself begins and ends at once

_MNEMONICS = {
    "AA": "A:", "AE": "a", "AH": "@", "AO": "O:", "AW": "aU", "AY": "aI", "B": "b", "CH": "tS", "D": "d", "DH": "D",
    "EH": "E", "ER": "3:", "EY": "eI", "F": "f", "G": "g", "HH": "h", "IH": "I", "IY": "i:", "JH": "dZ", "K": "k",
    "L": "l", "M": "m", "N": "n", "NG": "N", "OW": "oU", "OY": "OI", "P": "p", "R": "r", "S": "s", "SH": "S", "T": "t",
    "TH": "T", "UH": "U", "UW": "u:", "V": "v", "W": "w", "Y": "j", "Z": "z", "ZH": "Z",
}  # fmt: skip
_STOPS = frozenset(",.;:!?()\"'")
_VOWELS = frozenset(symbol for symbol in PHONES if symbol[0] in "AEIOU")


class EspeakEngine:
    """See `app.tts.engine.SpeechEngine`. All English voices of the library, times exact."""

    class Options(BaseModel):
        """Attributes: see docs/speech.md."""

        model_config = ConfigDict(extra="forbid", frozen=True)

        seconds: float = Field(default=10.0, gt=0)  # time limit of one call
        variants: tuple[str, ...] = ("f2",)  # of every voice to offer: f1 to f5, m1 to m8, Annie ...

    name = "espeak"
    pronounces = True

    def __init__(self, options: Options | None = None) -> None:
        self._options = options = options or self.Options()
        self._espeak = EspeakProcess(self.name, options.seconds)
        self._lock = threading.Lock()
        self._voices: dict[str, tuple[Voice, str]] = {}  # and espeak's identifier

    def voices(self) -> tuple[Voice, ...]:
        try:
            return tuple(voice for voice, _ in self._known().values())
        except MissingExtra:
            missing = "mary[espeak]: pip install 'mary[espeak]'"
            name = "English (America)"
            return (Voice(DEFAULT, name, "en-US", "male", RATE, LICENCE, self.name, installed=False, missing=missing),)

    def warm_up(self) -> None:
        """Start the process."""
        self._known()

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        known = self._known()
        if (voice or DEFAULT) not in known:
            raise NotFound(
                f"speech engine espeak has no voice {voice!r}", field="voice", advice=f"It has: {', '.join(known)}."
            )
        _, identifier = known[voice or DEFAULT]
        words = text.split()
        spoken = [_spoken(word, lexicon) for word in words]
        said = " ".join(spoken)
        uttered = self._espeak.speak(said, identifier, speed, mnemonics="[[" in said)
        starts = np.cumsum([0, *(len(word) + 1 for word in spoken[:-1])]).tolist()
        owners = [max(0, bisect_right(starts, phoneme.position) - 1) for phoneme in uttered.phonemes]
        sounds = merge(_units(uttered, owners))
        if all(sound.symbol == SILENCE for sound in sounds):
            raise NothingToSay("the text has nothing to say", field="text")
        return _speech(self._divided(sounds, spoken, identifier), words, uttered)

    def close(self) -> None:
        """End the process; speaking again starts another."""
        self._espeak.close()

    @property
    def process(self) -> int | None:
        """Number of the process in which the library runs; None if there is none."""
        return self._espeak.pid

    def _known(self) -> dict[str, tuple[Voice, str]]:
        """The voices by id, the default first."""
        with self._lock:
            if not self._voices:
                listed = self._espeak.voices()
                english = [voice for voice in listed if voice.language == "en" or voice.language.startswith("en-")]
                english.sort(key=lambda voice: voice.language != DEFAULT)
                self._voices = {voice.id: (voice, identifier) for voice, identifier in self._offered(english, listed)}
            return self._voices

    def _offered(self, english: Sequence[EspeakVoice], listed: Sequence[EspeakVoice]) -> list[tuple[Voice, str]]:
        variants = {each.identifier.removeprefix("!v/"): each for each in listed if each.language == "variant"}
        if unknown := [name for name in self._options.variants if name not in variants]:
            raise ConfigError(
                f"espeak has no variant {unknown[0]!r}",
                field="speech.engines.espeak.variants",
                advice=f"It has: {', '.join(sorted(variants))}.",
            )
        offered: list[tuple[Voice, str]] = []
        for variant in ("", *self._options.variants):
            for each in english:
                tail = f"+{variant}" if variant else ""
                name = f"{each.name}, {variants[variant].name}" if variant else each.name
                sex = variants[variant].sex if variant else each.sex
                voice = Voice(each.language + tail, name, bcp47(each.language), sex, RATE, LICENCE, self.name)
                offered.append((voice, each.identifier + tail))
        return offered

    def _divided(self, sounds: Sequence[Sound], spoken: Sequence[str], identifier: str) -> list[Sound]:
        """Give each phone to its word where espeak counts several written words as one ("of the").

        The words of such a group are said one by one, without sound, and laid beside the phones.
        """
        heard = sorted({sound.word for sound in sounds if sound.word >= 0})
        groups = [range(start, end) for start, end in pairwise([*heard, len(spoken)]) if end - start > 1]
        if not groups:
            return list(sounds)
        alone = [word for group in groups for word in group]
        said = dict(zip(alone, self._espeak.ipa([spoken[word] for word in alone], identifier), strict=True))
        result = list(sounds)
        for group in groups:
            places = [at for at, sound in enumerate(sounds) if sound.word == group.start]
            spans = assign([sounds[at].symbol for at in places], [phones_of(said[word]) for word in group])
            for word, span in zip(group, spans, strict=True):
                for at in span:
                    result[places[at]] = replace(sounds[places[at]], word=word)
        return result


def bcp47(language: str) -> str:
    """A language as espeak writes it (``en-us-nyc``) in the form of BCP 47 (``en-US-x-nyc``)."""
    first, *rest = language.split("-")
    if rest and len(rest[0]) == 2:
        rest[0] = rest[0].upper()
    elif rest and len(rest[0]) == 4:
        rest[0] = rest[0].capitalize()
    if len(rest) == 2 and len(rest[1]) < 5:  # too short for the name of a dialect
        rest.insert(1, "x")
    return "-".join([first, *rest])


def stress(pronunciation: Pronunciation) -> int:
    """Which phone to stress, since a lexicon does not say: the first full vowel, else the first vowel, else -1."""
    vowels = [at for at, phone in enumerate(pronunciation) if phone in _VOWELS]
    return next((at for at in vowels if pronunciation[at] != "AH"), vowels[0] if vowels else -1)


def mnemonics(pronunciation: Pronunciation) -> str:
    """ARPAbet as espeak's own phonemes, in the brackets that make it read them."""
    stressed = stress(pronunciation)
    letters = [_MNEMONICS[phone] for phone in pronunciation]
    if stressed >= 0:
        letters[stressed] = "'" + ("V" if pronunciation[stressed] == "AH" else letters[stressed])
    return f"[[{'|'.join(letters)}]]"  # the bars keep T and SH from being CH


def _spoken(written: str, lexicon: Lexicon) -> str:
    """What espeak reads for a written word: nothing of it is a command."""
    plain = "".join(letter if letter.isprintable() else " " for letter in written).replace("[[", "((")
    pronunciation = lexicon.get(folded(plain))
    if pronunciation is None:
        return plain
    before, _, after = ("".join(letter for letter in part if letter in _STOPS) for part in parts(plain))
    return f"{before}{mnemonics(pronunciation)}{after}"


def _units(uttered: Uttered, owners: Sequence[int]) -> list[Unit]:
    """Timed units from the first sample to the last; owners never go back, whatever the positions do."""
    edges = [min(phoneme.sample, len(uttered.samples)) for phoneme in uttered.phonemes]
    edges = [*np.maximum.accumulate(_spread([*edges, len(uttered.samples)])).tolist()]
    units = [Unit("", 0.0, edges[0] / uttered.rate)] if edges[0] > 0 else []
    latest = 0
    for at, phoneme in enumerate(uttered.phonemes):
        latest = max(latest, owners[at])
        start, end = edges[at] / uttered.rate, edges[at + 1] / uttered.rate
        units.append(Unit(_letters(phoneme), start, end, latest if phoneme.ipa else -1))
    return units


def _letters(phoneme: Timed) -> str:
    """The IPA; the open front vowel of British voices is that of "cat" and no other in English."""
    return "æ" if phoneme.ipa.strip("ˈˌ") == "a" else phoneme.ipa


def _spread(edges: Sequence[int]) -> list[float]:
    """Phonemes that begin at the same sample share the time up to the next: each of them is heard."""
    spread: list[float] = []
    at = 0
    while at < len(edges):
        same = next((n for n in range(at, len(edges)) if edges[n] > edges[at]), len(edges))
        after = edges[same] if same < len(edges) else edges[at]
        spread += [edges[at] + (after - edges[at]) * step / (same - at) for step in range(same - at)]
        at = same
    return spread


def _speech(sounds: Sequence[Sound], words: Sequence[str], uttered: Uttered) -> Speech:
    """The sound with silence at both ends, and what is heard when."""
    edge = round(EDGE * uttered.rate)
    samples = np.pad(uttered.samples, edge)
    lead, duration = edge / uttered.rate, len(samples) / uttered.rate
    moved = [replace(sound, start=sound.start + lead, end=sound.end + lead) for sound in sounds]
    if moved[0].symbol == SILENCE:
        moved[0] = replace(moved[0], start=0.0)
    else:
        moved.insert(0, Sound(SILENCE, 0.0, lead))
    if moved[-1].symbol == SILENCE:
        moved[-1] = replace(moved[-1], end=duration)
    else:
        moved.append(Sound(SILENCE, moved[-1].end, duration))
    phones = tuple(Phone(sound.symbol, sound.start, sound.end) for sound in moved)
    numbered = [(word, range(number, number + 1)) for number, word in enumerate(words)]
    return Speech(samples, uttered.rate, phones, words_of(moved, numbered))
