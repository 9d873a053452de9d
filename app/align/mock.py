"""An aligner that does not listen: it spreads the phones of the text evenly over the loud part of the sound."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.align.aligner import Alignment, assemble, checked
from app.align.boundaries import activity
from app.align.dictionary import NO_LEXICON, Dictionary, Lexicon
from app.align.phoneset import Sound
from app.errors import NothingToSay

FASTEST = 30.0  # phones a second: nobody speaks faster, nor, in a sentence, slower than the slowest
SLOWEST = 3.0


class MockAligner:
    """See `app.align.aligner.Aligner`. The same sound and text always give the same times.

    Its confidence is 1 if the text could be said in the time there is, else 0.
    """

    name = "mock"

    def __init__(self, dictionary: Dictionary | None = None) -> None:
        self._dictionary = dictionary or Dictionary()

    def align(self, samples: NDArray[np.float32], rate: int, text: str, *, lexicon: Lexicon = NO_LEXICON) -> Alignment:
        checked(samples, rate, text)
        words = self._dictionary.with_lexicon(lexicon).read(text)
        said = [(phone, number) for number, word in enumerate(words) for phone in (*word.pronunciations, ())[0]]
        if not said:
            raise NothingToSay("the transcript has no word that sounds", field="text")
        duration = len(samples) / rate
        times, loud = activity(samples, rate)
        heard = times[loud]
        start, end = (float(heard[0]), float(heard[-1])) if len(heard) > 1 else (0.0, duration)
        edges = np.linspace(start, end, len(said) + 1).tolist()
        sounds = [Sound(phone, edges[at], edges[at + 1], number) for at, (phone, number) in enumerate(said)]
        return assemble(
            sounds,
            [word.text for word in words],
            duration,
            guessed=[word.text for word in words if word.guessed],
            confidence=float(SLOWEST <= len(said) / (end - start) <= FASTEST),
        )
