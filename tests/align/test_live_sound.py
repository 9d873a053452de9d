"""Live sound: nothing is lost, nothing waits too long, and lips follow what is heard."""

import threading
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
import soxr
from hypothesis import given, settings
from hypothesis import strategies as st

from app.align.ear import CUSHION, LONGEST, LOOK, OUT_RATE, STEP
from app.align.hama import HamaRecogniser
from app.align.live_sound import RATES, LiveSound
from app.align.mock_recogniser import MockRecogniser
from app.align.recogniser import Samples
from app.errors import Gone, InputError, NothingToSay, OverCapacity, RecognitionFailed
from app.speech import PHONES, SILENCE, Phone, Speech, Word

BOUND = STEP + LOOK + CUSHION


def live(rate: int = 16_000, **options: object) -> LiveSound:
    return LiveSound(MockRecogniser(), rate, wait=0.0, **options)  # type: ignore[arg-type]


def tone(seconds: float, rate: int = 16_000, loudness: float = 0.3) -> Samples:
    return (loudness * np.sin(2 * np.pi * 300 * np.arange(round(seconds * rate)) / rate)).astype(np.float32)


def drain(speeches) -> list[Speech]:
    """What can be had now."""
    taken = []
    for speech in speeches:
        if speech is None:
            break
        taken.append(speech)
    return taken


def push(sound: LiveSound, samples: Samples, chunk: float = 0.02) -> tuple[list[Speech], float]:
    """Push in chunks (seconds) as time would bring them; all the speech, and the longest that anything waited."""
    speeches, taken, longest = sound.speeches(), [], 0.0
    step = max(1, round(chunk * sound.rate))
    for at in range(0, len(samples), step):
        sound.push_audio(samples[at : at + step])
        taken += drain(speeches)
        longest = max(longest, sound.waiting)
    sound.end()
    return taken + drain(speeches), longest


def joined(taken: Sequence[Speech]) -> tuple[Samples, list[Phone], list[Word]]:
    """The whole of it, on one axis."""
    at, phones, words = 0.0, [], []
    for speech in taken:
        phones += [Phone(phone.symbol, at + phone.start, at + phone.end) for phone in speech.phones]
        words += [Word(word.text, at + word.start, at + word.end) for word in speech.words]
        at += speech.duration
    return np.concatenate([speech.samples for speech in taken]), phones, words


def check(speech: Speech) -> None:
    assert speech.rate == OUT_RATE
    assert speech.samples.dtype == np.float32
    assert speech.phones[0].start == 0
    assert speech.phones[-1].end == pytest.approx(speech.duration)
    for phones in (speech.phones, speech.around):
        assert all(phone.end > phone.start and phone.symbol in PHONES for phone in phones)
        for before, after in pairwise(phones):
            assert before.end == pytest.approx(after.start, abs=1e-6)
    assert speech.around[0].start <= 0
    assert speech.around[-1].end >= speech.duration - 1e-6


@settings(max_examples=30, deadline=None)
@given(
    rate=st.sampled_from(RATES),
    seconds=st.floats(0.0, 3.0),
    chunk=st.floats(0.001, 1.5),
    quiet=st.floats(0.0, 1.0),
)
def test_sound_is_neither_lost_nor_changed_and_phones_have_no_gaps(
    rate: int, seconds: float, chunk: float, quiet: float
) -> None:
    samples = np.concatenate([tone(seconds, rate), np.zeros(round(quiet * rate), np.float32), tone(0.3, rate)])
    taken, _ = push(live(rate), samples, chunk)
    for speech in taken:
        check(speech)
    whole, _, _ = joined(taken)
    assert len(whole) == round(len(samples) * OUT_RATE / rate)
    expected = samples if rate == OUT_RATE else soxr.resample(samples, rate, OUT_RATE, quality="MQ")
    count = min(len(whole), len(expected))
    assert float(np.abs(whole[:count] - expected[:count]).max()) < 1e-3  # one piece of sound, resampled once


@pytest.mark.parametrize("rate", RATES)
def test_what_is_pushed_at_the_pace_of_time_waits_a_bounded_time(rate: int) -> None:
    taken, longest = push(live(rate), tone(6.0, rate))
    assert longest <= BOUND + 0.02 + 0.02  # the chunk in hand, and what the resampler holds back
    assert max(speech.duration for speech in taken[:-1]) <= STEP + 1e-6


def test_pieces_begin_on_pictures() -> None:
    taken, _ = push(live(), tone(3.0))
    assert all(len(speech.samples) % 1920 == 0 for speech in taken[:-1])


def test_a_burst_is_taken_in_larger_pieces() -> None:
    sound = live()
    sound.push_audio(tone(5.0))
    taken = drain(sound.speeches())
    assert max(speech.duration for speech in taken) == pytest.approx(LONGEST)
    assert sound.waiting < BOUND


def test_silence_closes_the_mouth() -> None:
    taken, _ = push(live(), np.concatenate([tone(0.6), np.zeros(32_000, np.float32)]))
    _, phones, _ = joined(taken)
    assert {phone.symbol for phone in phones if phone.start > 0.9} == {SILENCE}
    assert {phone.symbol for phone in phones if phone.end < 0.5} > {"AA"}


def test_silence_alone_is_only_silence() -> None:
    taken, _ = push(live(), np.zeros(16_000, np.float32))
    assert {phone.symbol for speech in taken for phone in (*speech.phones, *speech.around)} == {SILENCE}


def test_a_piece_knows_what_is_around_it() -> None:
    taken, _ = push(live(), tone(3.0))
    for before, speech in pairwise(taken[1:-1]):
        assert speech.around[0].start <= -0.3
        assert speech.around[-1].end >= speech.duration + 0.05
        last = before.phones[-1]
        touching = next(phone for phone in speech.around if phone.end > -1e-6)
        assert touching.symbol == last.symbol or touching.end == pytest.approx(0, abs=1e-6)


def test_a_piece_knows_what_sounds_after_it() -> None:
    taken, _ = push(live(), tone(3.0))
    whole, at = joined(taken)[0], 0
    for piece in taken:
        at += len(piece.samples)
        assert piece.recognised
        assert piece.ahead is not None
        assert np.array_equal(piece.ahead, whole[at : at + len(piece.ahead)])
    assert np.mean([len(piece.ahead) for piece in taken[:-1]]) > 0.15 * OUT_RATE  # type: ignore[arg-type]
    assert len(taken[-1].ahead) == 0  # type: ignore[arg-type]


def test_flush_speaks_what_is_there_and_goes_on() -> None:
    sound = live()
    speeches = sound.speeches()
    sound.push_audio(tone(0.3))
    assert drain(speeches) == []
    sound.flush()
    (first,) = drain(speeches)
    assert first.duration == pytest.approx(0.3)
    assert sound.waiting == pytest.approx(0)
    sound.push_audio(tone(0.3))
    assert drain(speeches) == []
    sound.end()
    (second,) = drain(speeches)
    assert second.duration == pytest.approx(0.3)
    assert list(speeches) == []


def test_interrupted_sound_is_forgotten_and_what_follows_is_spoken() -> None:
    sound = live()
    speeches = sound.speeches()
    sound.push_audio(tone(2.0))
    next(speeches)
    sound.interrupt()
    assert sound.waiting == 0
    sound.push_audio(np.zeros(4_800, np.float32))
    sound.end()
    assert next(speeches) is None  # between what was interrupted and what follows
    taken = drain(speeches)
    assert sum(speech.duration for speech in taken) == pytest.approx(0.3)
    assert not np.concatenate([speech.samples for speech in taken]).any()


def test_cancelled_sound_ends_at_once() -> None:
    sound = live()
    speeches = sound.speeches()
    sound.push_audio(tone(2.0))
    next(speeches)
    sound.cancel()
    assert list(speeches) == []
    with pytest.raises(Gone):
        sound.push_audio(tone(0.1))


def test_nothing_pushed_is_nothing_to_say() -> None:
    sound = live()
    sound.end()
    sound.end()
    assert list(sound.speeches()) == []
    with pytest.raises(Gone):
        sound.push_audio(b"")


def test_while_nothing_comes_it_says_so() -> None:
    speeches = live().speeches()
    assert next(speeches) is None
    assert next(speeches) is None


def test_more_than_may_wait_is_refused_whole() -> None:
    sound = live(limit=1.0)
    sound.push_audio(tone(0.9))
    with pytest.raises(OverCapacity, match=r"0\.9 s of sound wait"):
        sound.push_audio(tone(0.2))
    assert sound.waiting == pytest.approx(0.9)
    speeches = sound.speeches()
    assert drain(speeches)
    sound.push_audio(tone(0.2))
    sound.end()
    assert drain(speeches)


@pytest.mark.parametrize(
    ("sound", "what"),
    [
        (b"abc", "3 bytes"),
        (np.zeros((2, 4), np.float32), "mono"),
        (np.array([1, 2]), "int64"),
        (np.array([0.1, np.nan]), "no numbers"),
        (np.array([np.inf]), "no numbers"),
    ],
)
def test_what_is_no_sound_is_refused(sound: object, what: str) -> None:
    feed = live()
    with pytest.raises(InputError, match=what):
        feed.push_audio(sound)  # type: ignore[arg-type]
    assert feed.waiting == 0


@pytest.mark.parametrize("rate", [0, 8_000, 44_100, -1])
def test_another_rate_is_refused(rate: int) -> None:
    with pytest.raises(InputError) as error:
        live(rate)
    assert error.value.field == "rate"
    assert "24,000" in error.value.advice


def test_bytes_integers_and_floats_are_the_same_sound() -> None:
    integers = np.round(tone(1.0) * 32767).astype("<i2")
    sounds = [integers.tobytes(), integers, integers / 32768]
    results = []
    for given_as in sounds:
        sound = live()
        sound.push_audio(given_as)
        sound.end()
        results.append(joined(drain(sound.speeches())))
    for samples, phones, _ in results[1:]:
        np.testing.assert_allclose(samples, results[0][0], atol=1e-6)
        assert phones == results[0][1]


def test_sound_may_come_from_another_thread() -> None:
    sound = LiveSound(MockRecogniser(), 16_000)
    whole = tone(2.0)

    def work() -> None:
        for at in range(0, len(whole), 777):
            sound.push_audio(whole[at : at + 777])
        sound.end()

    thread = threading.Thread(target=work)
    thread.start()
    taken = [speech for speech in sound.speeches() if speech is not None]
    thread.join()
    assert sum(len(speech.samples) for speech in taken) == 2 * OUT_RATE


def test_a_recogniser_that_fails_is_told() -> None:
    class Broken(MockRecogniser):
        def hear(self, samples: Samples) -> list:  # noqa: ARG002
            raise RecognitionFailed("recogniser broken: no")

    sound = LiveSound(Broken(), 16_000)
    sound.push_audio(tone(1.0))
    with pytest.raises(RecognitionFailed):
        next(sound.speeches())


# --- real ears --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hama() -> HamaRecogniser:
    return HamaRecogniser()


def spoken_live(hama: HamaRecogniser, speech: Speech, transcript: str = "") -> tuple[list[Phone], list[Word]]:
    sound = LiveSound(hama, 24_000, transcript=transcript, wait=0.0)
    taken, longest = push(sound, speech.samples, 0.04)
    assert longest <= BOUND + 0.06
    _, phones, words = joined(taken)
    return phones, words


def test_with_a_transcript_words_and_phones_are_those_of_the_text(
    hama: HamaRecogniser, spoken: tuple[Speech, ...]
) -> None:
    for speech in spoken:
        text = " ".join(word.text for word in speech.words)
        phones, words = spoken_live(hama, speech, text)
        assert [word.text for word in words] == [word.text for word in speech.words]
        for word, due in zip(words, speech.words, strict=True):
            assert word.start == pytest.approx(due.start, abs=0.12)
        due = [phone.symbol for phone in speech.phones if phone.symbol in ("M", "B", "P")]
        heard = [p.symbol for p in phones if p.symbol in ("M", "B", "P")]
        assert len(heard) >= len(due)  # one that is cut in two counts twice


def test_without_one_there_are_phones_and_no_words(hama: HamaRecogniser, spoken: tuple[Speech, ...]) -> None:
    phones, words = spoken_live(hama, spoken[0])
    assert words == []
    assert len({phone.symbol for phone in phones}) > 6


def test_a_wrong_transcript_gives_way_to_what_is_heard(hama: HamaRecogniser, spoken: tuple[Speech, ...]) -> None:
    text = "Nobody ever knew why the yellow umbrella of my uncle was hidden under an old oak tree near home."
    speech = spoken[1]
    with_text, words = spoken_live(hama, speech, text)
    alone, _ = spoken_live(hama, speech)
    end = speech.duration / 2
    assert [p.symbol for p in with_text if p.start > end] == [p.symbol for p in alone if p.start > end]
    assert len(words) < len(text.split()) / 2


def test_a_transcript_without_a_word_that_sounds_is_refused() -> None:
    with pytest.raises(NothingToSay) as error:
        LiveSound(MockRecogniser(), 16_000, transcript="☃ 🙂")
    assert error.value.field == "transcript"
