"""Piper's voice files: an ONNX network and the JSON beside it that says how to use it."""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from app.errors import SpeechFailed
from app.tts.onnx_output import expose, outputs_of

PAD, START, END = "_", "^", "$"
SAMPLES_PER_STEP = 256  # of the durations, where the JSON says nothing else

_LICENCES = {"cc0": "CC0-1.0", "mit": "MIT", "apache": "Apache-2.0", "public domain": "CC-PDDC"}
_WOMEN = frozenset(["amy", "lessac", "kathleen", "kristin", "ljspeech", "alba", "cori", "jenny_dioco"])
_MEN = frozenset(["joe", "ryan", "alan", "john", "norman", "bryce", "danny", "kusal"])


@dataclass(frozen=True, slots=True)
class VoiceFile:
    """What the JSON beside a network says.

    Attributes:
        path: of the network.
        rate: samples a second.
        language: BCP 47.
        espeak: the espeak voice whose phonemes it reads.
        symbols: phoneme to the numbers that the network takes for it.
        clusters: phonemes of several letters.
        scales: how noisy the sound is, how long, and how noisy the durations are, at speed 1.
        speakers: name to number; empty if there is only one.
        step: samples of one unit of its durations.
    """

    path: Path
    rate: int
    language: str
    espeak: str
    symbols: Mapping[str, tuple[int, ...]]
    clusters: frozenset[str]
    scales: tuple[float, float, float]
    speakers: Mapping[str, int]
    step: int

    @property
    def name(self) -> str:
        """File name without its end, e.g. ``en_US-joe-medium``."""
        return self.path.stem

    @property
    def sex(self) -> str:
        """As far as the name tells: of the better known English voices, or with the word in it."""
        parts = set(re.split(r"[-_]", self.name.lower())) | set(self.name.lower().split("-"))
        for sex, known in (("female", _WOMEN), ("male", _MEN)):
            if sex in parts or parts & known:
                return sex
        return ""

    @property
    def licence(self) -> str:
        """SPDX identifier from the model card beside it, where it names one that is known; else empty."""
        try:
            card = (self.path.parent / "MODEL_CARD").read_text(encoding="utf-8", errors="replace")
        except OSError:
            return ""
        said = re.search(r"Licen[cs]e:\s*(.+)", card)
        return next((spdx for name, spdx in _LICENCES.items() if said and name in said[1].lower()), "")

    def letters(self, ipa: str) -> list[str]:
        """IPA as the phonemes that the network was trained on: single code points, accents apart, known clusters."""
        plain = unicodedata.normalize("NFD", ipa)
        letters: list[str] = []
        at = 0
        while at < len(plain):
            size = next((n for n in (3, 2) if plain[at : at + n] in self.clusters), 1)
            letters.append(plain[at : at + size])
            at += size
        return [letter for letter in letters if letter in self.symbols]


def read_voice(path: Path) -> VoiceFile:
    """Read the JSON beside a network.

    Raises:
        SpeechFailed: there is none, it cannot be read, or it is of a voice that reads no IPA.
    """
    beside = path.with_name(path.name + ".json")
    try:
        about: dict[str, Any] = json.loads(beside.read_text(encoding="utf-8"))
        if about.get("phoneme_type", "espeak") != "espeak":
            raise SpeechFailed(
                f"speech engine piper: {path.name} reads {about['phoneme_type']} instead of espeak's phonemes",
                advice="Choose a voice whose phoneme_type is espeak.",
            )
        inference = about.get("inference", {})
        espeak = str(about["espeak"]["voice"])
        symbols = {key: tuple(map(int, numbers)) for key, numbers in about["phoneme_id_map"].items()}
        if missing := {PAD, START, END} - set(symbols):
            raise KeyError(", ".join(sorted(missing)))
        return VoiceFile(
            path=path,
            rate=int(about["audio"]["sample_rate"]),
            language=str(about.get("language", {}).get("code", espeak)).replace("_", "-"),
            espeak=espeak,
            symbols=symbols,
            clusters=frozenset("".join(cluster) for cluster in about.get("vowel_clusters") or ()) & set(symbols),
            scales=(
                float(inference.get("noise_scale", 0.667)),
                float(inference.get("length_scale", 1.0)),
                float(inference.get("noise_w", 0.8)),
            ),
            speakers=dict(about.get("speaker_id_map") or {}) if about.get("num_speakers", 1) > 1 else {},
            step=int(about.get("hop_length", SAMPLES_PER_STEP)),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise SpeechFailed(
            f"speech engine piper: {beside.name} cannot be used: {reason}", advice=f"It belongs beside {path.name}."
        ) from error


class PiperModel:
    """One network with its durations readable, if it has exactly one tensor of them. `run` is for any thread."""

    def __init__(self, voice: VoiceFile) -> None:
        self.voice = voice
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3  # errors only
        try:
            model = voice.path.read_bytes()
            durations = outputs_of(model, "Ceil")
            self._session = onnxruntime.InferenceSession(
                expose(model, durations[0]) if len(durations) == 1 else model,
                options,
                providers=["CPUExecutionProvider"],
            )
        except Exception as error:  # onnxruntime's errors have no common class
            raise SpeechFailed(
                f"speech engine piper: {voice.path.name} cannot be loaded: {error}", advice="Download it anew."
            ) from error
        self._timed = len(durations) == 1

    def run(
        self, letters: Sequence[str], speed: float, speaker: int
    ) -> tuple[NDArray[np.float32], list[tuple[float, float]] | None]:
        """Speak phonemes that the voice knows.

        Args:
            letters: keys of the voice's symbols, the start and the end not among them.
            speed: 1 is the voice's own pace.
            speaker: its number, for voices that have several.

        Returns:
            samples, float32 of shape (n,), and the start and end in seconds of the start symbol, each letter and the
            end symbol; None if the network does not tell.
        """
        pad = self.voice.symbols[PAD]
        sizes: list[int] = []
        numbers: list[int] = []
        for letter in (START, *letters, END):
            taken = self.voice.symbols[letter] + (() if letter == END else pad)
            numbers += taken
            sizes.append(len(taken))
        noise, length, restless = self.voice.scales
        given: dict[str, NDArray[Any]] = {
            "input": np.array([numbers], np.int64),
            "input_lengths": np.array([len(numbers)], np.int64),
            "scales": np.array([noise, length / speed, restless], np.float32),
        }
        if self.voice.speakers:
            given["sid"] = np.array([speaker], np.int64)
        sound, *others = self._session.run(None, given)
        samples = np.asarray(sound, np.float32).reshape(-1)
        samples /= max(1.0, float(np.abs(samples).max(initial=0.0)))
        if not self._timed:
            return samples, None
        durations = np.asarray(others[-1], np.float64).reshape(-1)
        edges = np.concatenate([[0.0], np.cumsum(durations)]) * self.voice.step / self.voice.rate
        if len(durations) != len(numbers) or abs(edges[-1] - len(samples) / self.voice.rate) > 0.05:
            return samples, None
        at = np.cumsum([0, *sizes])
        return samples, [(float(edges[a]), float(edges[b])) for a, b in pairwise(at)]
