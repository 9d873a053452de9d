"""A recogniser by hama: a small network with its own engine, 5 MB of weights in its wheel (Apache-2.0).

Chosen by measurement (docs/speech.md): it hears three quarters of a real talker's phones right, where pocketsphinx's
phone loop hears a third, at 0.04 of the sound's length on one core. It needs no network and no other library than
numpy. It lets other threads run while it works.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from app.align.phoneset import phones_of
from app.align.recogniser import RATE, SILENT, Heard, Samples
from app.errors import MissingExtra, RecognitionFailed

FRAME = 0.020  # 20 ms: the grid of its times
LATE = 0.040  # 40 ms: its phones are this late, against those of an aligner
LEAST_SECONDS = 1.2  # it levels what it hears, so a shorter piece of noise would become speech; noise is put before it
NOISE = 2e-4  # peak of that noise
LONG = 0.080  # 80 ms: two phones written as one sign are apart by so much at most

_TIE = "\u0361"  # ties two letters to one sound, as in t͡ʃ


class HamaRecogniser:
    """See `app.align.recogniser.Recogniser`."""

    name = "hama"

    def __init__(self) -> None:
        self._lock = threading.Lock()  # nothing promises that its engine may be used from several threads
        self._model: Any = None

    def warm_up(self) -> None:
        with self._lock:
            self._load()

    def hear(self, samples: Samples) -> Sequence[Heard]:
        if not len(samples) or float(np.abs(samples).max()) < SILENT:
            return []
        missing = max(0, round(LEAST_SECONDS * RATE) - len(samples))
        noise = np.random.default_rng(0).uniform(-NOISE, NOISE, missing)  # the same every time
        sound = np.concatenate([noise.astype(np.float32), samples])
        with self._lock:
            model = self._load()
            try:
                tokens = model.transcribe_waveform(sound, RATE).frame_token_ids
            except Exception as error:
                raise RecognitionFailed(f"recogniser {self.name}: {type(error).__name__}: {error}") from error
        signs, blank = model.decoder_tokens, model.blank_id
        return _heard(tokens, signs, blank, -missing / RATE, len(samples) / RATE)

    def _load(self) -> Any:
        if self._model is None:
            try:
                from hama.asr import ASRModel

                self._model = ASRModel()
            except ImportError as error:
                raise MissingExtra(f"recogniser {self.name}: {error.name or error} is not installed") from error
            except Exception as error:  # its library is not for this machine
                raise RecognitionFailed(f"recogniser {self.name}: {type(error).__name__}: {error}") from error
        return self._model


def _heard(tokens: Sequence[int], signs: Sequence[str], blank: int, origin: float, duration: float) -> list[Heard]:
    """Phones of a run of frames; a sign lasts as long as its number is repeated, blanks part signs."""
    heard: list[Heard] = []
    first = 0
    for frame in range(1, len(tokens) + 1):
        if frame < len(tokens) and tokens[frame] == tokens[first]:
            continue
        if tokens[first] != blank:
            centre = origin + (first + frame) / 2 * FRAME - LATE
            said = _phones(signs[tokens[first]])
            for number, symbol in enumerate(said):
                at = centre + LONG * ((number + 0.5) / len(said) - 0.5)
                if -LATE <= at < duration:
                    heard.append(Heard(symbol, max(at, 0.0)))
        first = frame
    return heard


@cache
def _phones(sign: str) -> tuple[str, ...]:
    """ARPAbet of one of its signs; none of marks and the space between words."""
    return () if sign.startswith("<") else phones_of(sign.replace(_TIE, ""))
