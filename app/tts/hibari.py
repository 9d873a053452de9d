"""Hibari: a small neural voice whose model and letter-to-sound come in its wheel; the default engine.

Chosen because it needs nothing but onnxruntime, works offline, speaks a sentence in a few hundredths of a second on one
core, and holds the duration of every letter inside its graph, from which the phone times are read. The package is
young, so what is used of its insides is checked: exactly one tensor of durations, one duration a letter.
"""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import hibari
import numpy as np
import onnxruntime
from hibari import dsp
from hibari import voices as catalogue
from hibari.g2p import G2P
from hibari.g2p.normalize import normalize
from numpy.typing import NDArray

from app.align.boundaries import settle
from app.align.dictionary import NO_LEXICON, Lexicon, folded
from app.align.phoneset import Unit, merge
from app.errors import MissingExtra, NotFound, NothingToSay, SpeechFailed
from app.speech import Phone, Speech
from app.tts.engine import Voice
from app.tts.onnx_output import expose, outputs_of
from app.tts.splitting import LONGEST_PIECE, split
from app.tts.take import Take, joined, trimmed, words_of
from app.tts.text import fold
from app.tts.words import assign

RATE = 24_000  # samples a second
SEED = 0  # of the noise in the voice: the same text always makes the same samples
LAG = 0.047  # 47 ms: the network's durations trail the sound by this (median against a forced aligner)
MOST_SYMBOLS = 400  # in one run of the model; it was trained on single sentences
_LONG_NUMBER = re.compile(r"\d(?:[,.]?\d){15,}")  # read digit by digit: number words end somewhere


@dataclass(frozen=True, slots=True)
class _Written:
    """One letter of the phoneme string and the number of the spoken word it belongs to (-1: a space or a stop)."""

    symbol: str
    word: int


@dataclass(frozen=True, slots=True)
class _Reading:
    """How a text is said: the phoneme letters, and the written words with the spoken words that say them."""

    letters: tuple[_Written, ...]
    words: tuple[tuple[str, range], ...]
    spoken: int
    unread: tuple[str, ...] = ()


class HibariEngine:
    """See `app.tts.engine.SpeechEngine`. Voices beyond the wheel's are used if their file is there, never fetched.

    Args:
        lag: seconds by which the network's durations are taken to trail the sound; 0 to measure that.
    """

    name = "hibari"
    pronounces = True

    def __init__(self, *, lag: float = LAG) -> None:
        self._lag = lag
        self._lock = threading.Lock()
        self._models: dict[str, _Model] = {}
        self._readers: dict[bool, _Reader] = {}

    def voices(self) -> tuple[Voice, ...]:
        listed = sorted(catalogue.VOICES.items(), key=lambda item: item[0] != catalogue.DEFAULT)
        return tuple(
            Voice(
                id=key,
                name=key.capitalize(),
                language=about["language"],
                sex=about["gender"],
                rate=RATE,
                licence="Apache-2.0",
                engine=self.name,
                installed=(found := _model_path(key)) is not None,
                missing="" if found else f"voice file {about['file']}",
            )
            for key, about in listed
        )

    def warm_up(self) -> None:
        """Load the default voice and run everything once: the first run of a model is slow."""
        with self._lock:
            if catalogue.DEFAULT in self._models:
                return
        self.speak("Hello, I am qwyx, and it is 10:30.", voice=catalogue.DEFAULT)

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        model, reader = self._loaded(voice or catalogue.DEFAULT)
        pieces = [text] if len(text) <= LONGEST_PIECE else [clause.text for clause in split(text)]
        noise = np.random.default_rng(SEED)
        takes: list[Take] = []
        written: list[tuple[str, range]] = []
        unread: list[str] = []
        count = 0  # of spoken words
        for piece in pieces:
            reading = reader.read(piece, lexicon)
            unread += reading.unread
            written += [(word, range(span.start + count, span.stop + count)) for word, span in reading.words]
            for letters in _runs([letter for letter in reading.letters if model.knows(letter.symbol)]):
                take = trimmed(model.run(letters, speed, noise, count), RATE)
                if take is not None:
                    takes.append(take)
            count += reading.spoken
        if not takes:
            raise NothingToSay("the text has nothing to say", field="text")
        samples, sounds = joined(takes, RATE)
        phones = tuple(Phone(sound.symbol, sound.start, sound.end) for sound in sounds)
        return Speech(samples, RATE, phones, words_of(sounds, written), tuple(dict.fromkeys(unread)))

    def close(self) -> None:
        """Nothing is held that has to be given back."""

    def _loaded(self, voice: str) -> tuple[_Model, _Reader]:
        with self._lock:
            if voice not in self._models:
                self._models[voice] = _Model(self._installed(voice), self._lag)
            british = bool(catalogue.VOICES[voice]["british"])
            if british not in self._readers:
                self._readers[british] = _Reader(british)
            return self._models[voice], self._readers[british]

    def _installed(self, voice: str) -> Path:
        if voice not in catalogue.VOICES:
            known = ", ".join(known.id for known in self.voices())
            raise NotFound(f"speech engine hibari has no voice {voice!r}", field="voice", advice=f"It has: {known}.")
        path = _model_path(voice)
        if path is None:
            raise MissingExtra(
                f"hibari's voice {voice} is not installed",
                advice=f"Run once, online: python -c \"import hibari; hibari.Hibari(voice='{voice}')\"",
                field="voice",
            )
        return path


def _model_path(voice: str) -> Path | None:
    try:
        return Path(catalogue.voice_path(voice, download_missing=False))
    except FileNotFoundError:
        return None


# --- text to phoneme letters ------------------------------------------------------------------------------------------


class _Reader:
    """Hibari's letter-to-sound, keeping track of which written word each phoneme letter comes from."""

    def __init__(self, british: bool) -> None:
        self._g2p: Any = G2P(british=british)
        self._lock = (
            threading.Lock()
        )  # nothing promises that it may be used from several threads; it takes a millisecond

    def read(self, text: str, lexicon: Lexicon = NO_LEXICON) -> _Reading:
        words = text.split()
        prepared = [_LONG_NUMBER.sub(_digit_by_digit, fold(word)) for word in words]
        with self._lock:
            try:
                spoken = self._spoken(normalize(" ".join(prepared)))
                unread: tuple[str, ...] = ()
            except Exception:  # one odd word must not silence the sentence: leave out those that fail alone
                readable = [self._reads(word) for word in prepared]
                unread = tuple(word for word, good in zip(words, readable, strict=True) if not good)
                words = [word for word, good in zip(words, readable, strict=True) if good]
                prepared = [word for word, good in zip(prepared, readable, strict=True) if good]
                spoken = [part for word in prepared for part in self._spoken(normalize(word))]
        spoken = [(said, _pronounced(said, phonemes, lexicon)) for said, phonemes in spoken]
        expected = [normalize(word).split() for word in prepared]
        letters = [
            _Written(letter, number if letter.isalpha() or letter in "ˈˌː" else -1)
            for number, (_, phonemes) in enumerate(spoken)
            for letter in (" " if number else "") + phonemes
        ]
        spans = assign([text for text, _ in spoken], expected)
        pairs = ((word, span) for word, span in zip(words, spans, strict=True) if span)
        return _Reading(tuple(letters), tuple(pairs), len(spoken), unread)

    def _reads(self, word: str) -> bool:
        try:
            self._spoken(normalize(word))
        except Exception:
            return False
        return True

    def _spoken(self, normalized: str) -> list[tuple[str, str]]:
        """(text, phoneme letters) of each word of a normalised text, as it is divided by its spaces."""
        if not normalized:
            return []
        spoken: list[tuple[str, str]] = []
        text = phonemes = ""
        for token in self._g2p.phonemize_tokens(self._g2p.tokenize(normalized)):
            text += token.text
            phonemes += token.phonemes or ""
            if token.whitespace:
                spoken.append((text, phonemes))
                text = phonemes = ""
        return [*spoken, (text, phonemes)] if text else spoken


_STOPS = frozenset(';:,.!?—…"()“”')
_LETTERS = {
    "AA": "ɑ", "AE": "æ", "AH": "ʌ", "AO": "ɔ", "AW": "W", "AY": "I", "B": "b", "CH": "ʧ", "D": "d", "DH": "ð",
    "EH": "ɛ", "ER": "ɜɹ", "EY": "A", "F": "f", "G": "ɡ", "HH": "h", "IH": "ɪ", "IY": "i", "JH": "ʤ", "K": "k",
    "L": "l", "M": "m", "N": "n", "NG": "ŋ", "OW": "O", "OY": "Y", "P": "p", "R": "ɹ", "S": "s", "SH": "ʃ", "T": "t",
    "TH": "θ", "UH": "ʊ", "UW": "u", "V": "v", "W": "w", "Y": "j", "Z": "z", "ZH": "ʒ",
}  # fmt: skip
"""How the network writes ARPAbet."""


def _pronounced(said: str, phonemes: str, lexicon: Lexicon) -> str:
    """Phoneme letters of a spoken word: those of the lexicon, the first vowel stressed, if it has the word."""
    phones = lexicon.get(folded(said)) if lexicon else None
    if phones is None:
        return phonemes
    stops = phonemes[len(phonemes.rstrip("".join(_STOPS))) :]
    stressed = next((at for at, phone in enumerate(phones) if phone[0] in "AEIOU"), -1)
    return "".join(("ˈ" if at == stressed else "") + _LETTERS[phone] for at, phone in enumerate(phones)) + stops


def _digit_by_digit(number: re.Match[str]) -> str:
    return " ".join(letter for letter in number[0] if letter.isdigit())


# --- phoneme letters to sound and times -------------------------------------------------------------------------------


class _Model:
    """One voice's network with its durations readable. `run` may be called from several threads."""

    def __init__(self, path: Path, lag: float) -> None:
        self._lag = lag
        model = path.read_bytes()
        durations = outputs_of(model, "Clip")
        if len(durations) != 1:
            raise SpeechFailed(
                f"speech engine hibari {hibari.__version__}: expected one tensor of durations (Clip) in {path.name}, "
                f"found {len(durations)}; without it there are no phone times",
                advice="Install the pinned version: pip install hibari-tts==0.2.1",
            )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3  # errors only
        self._session = onnxruntime.InferenceSession(
            expose(model, durations[0]), options, providers=["CPUExecutionProvider"]
        )
        vocabulary = Path(hibari.__file__).parent / "assets" / "vocab.json"
        self._numbers: dict[str, int] = json.loads(vocabulary.read_text(encoding="utf-8"))

    def knows(self, letter: str) -> bool:
        return letter in self._numbers

    def run(self, letters: Sequence[_Written], speed: float, noise: np.random.Generator, count: int) -> Take:
        """Speak phoneme letters that the model knows; `count` is added to the numbers of their words."""
        numbers = [0, *(self._numbers[letter.symbol] for letter in letters), 0]  # a silent letter at both ends
        *spectrum, durations = self._session.run(
            None, {"ids": np.array([numbers], np.int64), "speed": np.array([speed], np.float32)}
        )
        durations = np.asarray(durations, np.float64).reshape(-1)
        total = float(durations.sum())
        if len(spectrum) != 6 or len(durations) != len(numbers) or not total > 0:
            raise SpeechFailed(
                f"speech engine hibari: {len(durations)} durations for {len(numbers)} letters",
                advice="Install the pinned version: pip install hibari-tts==0.2.1",
            )
        samples: NDArray[np.float32] = dsp.synth(*(part[0] for part in spectrum), noise)
        ends = (np.cumsum(durations) * (len(samples) / RATE / total)).tolist()
        units = [Unit("", 0.0, ends[0])]
        for at, letter in enumerate(letters):
            units.append(Unit(letter.symbol, ends[at], ends[at + 1], letter.word + count if letter.word >= 0 else -1))
        units.append(Unit("", ends[-2], ends[-1]))
        return Take(samples, settle(merge(units), samples, RATE, lag=self._lag))


def _runs(letters: Sequence[_Written]) -> Iterator[Sequence[_Written]]:
    """Cut letters at spaces into runs of at most `MOST_SYMBOLS`; runs without a sound are left out."""
    start = 0
    while start < len(letters):
        end = min(start + MOST_SYMBOLS, len(letters))
        if end < len(letters):
            end = next((at for at in range(end, start, -1) if letters[at].symbol == " "), end)
        if any(letter.word >= 0 for letter in letters[start:end]):
            yield letters[start:end]
        start = end
