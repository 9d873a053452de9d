from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from speakers import Odd, untimed

from app.align.aligner import Alignment
from app.align.dictionary import NO_LEXICON, Lexicon
from app.align.mock import MockAligner
from app.errors import AlignmentFailed, SpeechFailed
from app.speech import Phone, Speech
from app.tts import timed
from app.tts.limit import Limit
from app.tts.narrate import check
from app.tts.timed import AUTO, NATIVE, STEADY, TimedEngine, level_changes

TEXT = "hello there you"


class Ears(MockAligner):
    """Remembers what it was asked; may change what it finds, or fail."""

    def __init__(self, change: Callable[[Alignment], Alignment] = lambda found: found) -> None:
        super().__init__()
        self.change = change
        self.asked: list[tuple[str, Lexicon]] = []

    def align(self, samples: NDArray[np.float32], rate: int, text: str, *, lexicon: Lexicon = NO_LEXICON) -> Alignment:
        self.asked.append((text, lexicon))
        return self.change(super().align(samples, rate, text, lexicon=lexicon))


def made(change: Callable[[Speech], Speech], choice: str, ears: Ears | None = None) -> TimedEngine:
    ears = ears or Ears()
    return TimedEngine(Odd(change), choice, lambda: ears, Limit(60))


def as_it_is(speech: Speech) -> Speech:
    return speech


def shifted(speech: Speech) -> Speech:
    return replace(speech, phones=speech.phones[1:])


@pytest.mark.parametrize(
    ("change", "choice", "native", "aligned", "unsound"),
    [
        (as_it_is, AUTO, 1, 0, 0),
        (as_it_is, NATIVE, 1, 0, 0),
        (as_it_is, "mock", 0, 1, 0),
        (untimed, AUTO, 0, 1, 0),
        (shifted, AUTO, 0, 1, 1),
    ],
)
def test_where_the_times_come_from(
    change: Callable[[Speech], Speech], choice: str, native: int, aligned: int, unsound: int
) -> None:
    engine = made(change, choice)
    speech = check(engine.speak(TEXT), "odd")
    assert [word.text for word in speech.words] == TEXT.split()
    assert (engine.count.native, engine.count.aligned, engine.count.unsound) == (native, aligned, unsound)


@pytest.mark.parametrize("change", [untimed, shifted])
def test_native_takes_nothing_else(change: Callable[[Speech], Speech]) -> None:
    with pytest.raises(SpeechFailed, match="speech engine odd"):
        made(change, NATIVE).speak(TEXT)


def test_the_aligner_is_told_of_pronunciations_only_if_the_engine_follows_them() -> None:
    ears = Ears()
    engine = made(untimed, AUTO, ears)
    engine.speak(TEXT, lexicon={"you": ("Y", "AE")})
    engine.pronounces = False
    engine.speak(TEXT, lexicon={"you": ("Y", "AE")})
    assert [lexicon for _, lexicon in ears.asked] == [{"you": ("Y", "AE")}, {}]


@pytest.mark.parametrize(
    ("samples", "what"),
    [
        (np.zeros(24_000, np.float32), "made no sound"),
        (np.zeros(0, np.float32), "samples must be"),
        (np.full((24_000, 2), 0.1, np.float32), "samples must be"),
        (np.full(24_000, np.nan, np.float32), "not finite"),
        (np.full(24_000, 3.0, np.float32), "exceed 1"),
        (np.full(24_000, 0.1, np.float64), "samples must be"),
    ],
)
def test_sound_that_is_none_names_the_engine(samples: NDArray[np.float32], what: str) -> None:
    engine = made(lambda speech: replace(untimed(speech), samples=samples), AUTO)
    with pytest.raises(SpeechFailed, match=f"speech engine odd: .*{what}"):
        engine.speak(TEXT)


def noise(speech: Speech) -> Speech:
    samples = np.random.default_rng(0).normal(0, 0.1, len(speech.samples)).clip(-1, 1).astype(np.float32)
    return replace(untimed(speech), samples=samples)


def test_noise_is_no_speech() -> None:
    ears = Ears(lambda found: replace(found, confidence=0.001))
    with pytest.raises(SpeechFailed, match="speech engine odd does not say the text"):
        made(noise, AUTO, ears).speak(TEXT)
    assert made(noise, AUTO, ears).speak("hm").phones  # a word or two prove nothing


def test_speech_that_the_aligner_hardly_understands_is_no_noise() -> None:
    engine = made(untimed, AUTO, Ears(lambda found: replace(found, confidence=0.001)))
    assert level_changes(engine.speak(TEXT).samples, 24_000) > STEADY
    assert level_changes(np.zeros(10, np.float32), 24_000) == 0.0


@pytest.mark.parametrize("phones", [True, False])
def test_silence_is_refused_though_it_has_times(phones: bool) -> None:
    def silent(speech: Speech) -> Speech:
        return replace(speech if phones else untimed(speech), samples=np.zeros_like(speech.samples))

    for choice in (AUTO, NATIVE):
        with pytest.raises(SpeechFailed, match="speech engine odd: it made no sound"):
            made(silent, choice).speak(TEXT)


def test_an_aligner_that_hangs_or_breaks_is_named() -> None:
    gate = threading.Event()

    def hang(found: Alignment) -> Alignment:
        assert gate.wait(60)
        return found

    def breaks(_: Alignment) -> Alignment:
        raise ZeroDivisionError("oops")

    ears = Ears(hang)
    engine = TimedEngine(Odd(untimed), AUTO, lambda: ears, Limit(0.2))
    with pytest.raises(AlignmentFailed, match="speech engine odd: aligner mock took longer than"):
        engine.speak(TEXT)
    gate.set()
    with pytest.raises(AlignmentFailed, match="speech engine odd: aligner mock failed: ZeroDivisionError: oops"):
        made(untimed, AUTO, Ears(breaks)).speak(TEXT)
    assert engine.count.unaligned == 1


def test_an_aligners_advice_is_passed_on() -> None:
    def fails(_: Alignment) -> Alignment:
        raise AlignmentFailed("aligner mock: no", advice="Try again.")

    with pytest.raises(AlignmentFailed, match="speech engine odd: aligner mock: no") as caught:
        made(untimed, AUTO, Ears(fails)).speak(TEXT)
    assert caught.value.advice == "Try again."


def test_now_and_then_both_are_compared(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(timed, "CHECK_DELAY", 0.0)

    def late(found: Alignment) -> Alignment:
        moved = [Phone(each.symbol, each.start + 0.1, each.end + 0.1) for each in found.phones]
        return replace(found, phones=tuple(moved))

    def compared(engine: TimedEngine) -> tuple[int, int]:
        for _ in range(timed.CHECK_FIRST + 5):
            engine.speak(TEXT)
        for thread in threading.enumerate():
            if thread.name == "mary-check-times":
                thread.join(60)
        return engine.count.checked, engine.count.disagreed

    exact = Odd().speak(TEXT)
    agreeing = Ears(lambda found: replace(found, phones=exact.phones))
    assert compared(made(as_it_is, AUTO, agreeing)) == (1, 0)
    assert len(agreeing.asked) == 1
    assert compared(made(as_it_is, AUTO, Ears(late))) == (1, 1)
    assert "ms apart in the median" in caplog.text
    assert compared(made(as_it_is, NATIVE, agreeing)) == (0, 0)


def test_what_will_be_needed_is_loaded() -> None:
    class Cold(Ears):
        warm = 0

        def warm_up(self) -> None:
            self.warm += 1

    for choice, warm in ((AUTO, 0), (NATIVE, 0), ("mock", 1)):
        ears = Cold()
        engine = made(as_it_is, choice, ears)
        engine.warm_up()
        assert ears.warm == warm
        engine.close()
