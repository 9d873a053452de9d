from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from app.align.aligner import Alignment
from app.align.dictionary import NO_LEXICON, Dictionary, Lexicon
from app.align.mock import MockAligner
from app.errors import AlignmentFailed
from app.evaluation.sentences import SENTENCES
from app.evaluation.timing import aligner_row, engine_row
from app.speech import PHONES, SILENCE, Phone, Speech
from app.tts.mock import MockEngine


class Echo(MockAligner):
    """Finds the phones that it was given for a text, so much later; fails at others."""

    name = "echo"

    def __init__(self, known: dict[str, Speech], late: float) -> None:
        super().__init__()
        self.known, self.late = known, late

    def align(self, samples: NDArray[np.float32], rate: int, text: str, *, lexicon: Lexicon = NO_LEXICON) -> Alignment:
        if text not in self.known:
            raise AlignmentFailed("aligner echo: nothing")
        found = super().align(samples, rate, text, lexicon=lexicon)
        phones = [Phone(each.symbol, each.start + self.late, each.end + self.late) for each in self.known[text].phones]
        return replace(found, phones=tuple(phones))


SAID = {text: MockEngine().speak(text) for text in SENTENCES[:3]}


def test_an_aligner_that_is_late_by_so_much() -> None:
    row = aligner_row(Echo(SAID, 0.02), [*SAID.items(), ("more", SAID[SENTENCES[0]])], "mock")
    assert row.starts is not None
    spoken = sum(phone.symbol != SILENCE for speech in SAID.values() for phone in speech.phones)
    assert (row.measured, row.against, row.sentences, row.failures, row.starts.count) == ("echo", "mock", 3, 1, spoken)
    assert row.starts.median == pytest.approx(20)
    assert row.starts.bias == pytest.approx(20)
    assert row.starts.over_40 == 0


def test_an_engine_beside_an_aligner() -> None:
    row = engine_row("mock", MockEngine().speak, [*SENTENCES[:3], "..."], Echo(SAID, 0.05), calibrated=False)
    assert row.starts is not None
    assert (row.measured, row.against, row.calibrated, row.sentences, row.failures) == ("mock", "echo", False, 3, 1)
    assert row.starts.bias == pytest.approx(-50)
    assert row.starts.over_40 == 1


def test_nothing_to_compare() -> None:
    assert aligner_row(Echo({}, 0.0), [("hello", SAID[SENTENCES[0]])], "mock").starts is None


def test_the_sentences_are_a_hundred_and_have_every_phone() -> None:
    assert len(set(SENTENCES)) == len(SENTENCES) == 100
    words = [word for text in SENTENCES for word in Dictionary().read(text)]
    assert not [word.text for word in words if word.guessed]
    assert {phone for word in words for phone in word.pronunciations[0]} == set(PHONES) - {SILENCE}
