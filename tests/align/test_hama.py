import threading

import numpy as np
import pytest
import soxr
from recordings import Clip

from app.align.hama import HamaRecogniser
from app.align.recogniser import RATE, Recogniser, phones
from app.errors import RecognitionFailed
from app.speech import SILENCE, Phone, Speech


@pytest.fixture(scope="module")
def hama() -> HamaRecogniser:
    recogniser = HamaRecogniser()
    assert isinstance(recogniser, Recogniser)
    recogniser.warm_up()
    return recogniser


def heard(recogniser: HamaRecogniser, samples: np.ndarray, rate: int) -> list[Phone]:
    sound = soxr.resample(samples, rate, RATE).astype(np.float32)
    return phones(recogniser.hear(sound), sound)


def edits(one: list[str], other: list[str]) -> int:
    row = list(range(len(other) + 1))
    for n, symbol in enumerate(one, 1):
        before, row[0] = row[0], n
        for m, due in enumerate(other, 1):
            before, row[m] = row[m], min(row[m] + 1, row[m - 1] + 1, before + (symbol != due))
    return row[-1]


def symbols(spoken: tuple[Phone, ...] | list[Phone]) -> list[str]:
    return [phone.symbol for phone in spoken if phone.symbol != SILENCE]


def test_it_hears_the_phones_of_sentences_it_was_not_told(hama: HamaRecogniser, spoken: tuple[Speech, ...]) -> None:
    wrong = total = 0
    for speech in spoken:
        wrong += edits(symbols(speech.phones), symbols(heard(hama, speech.samples, speech.rate)))
        total += len(symbols(speech.phones))
    assert wrong / total < 0.2  # 0.09 over more sentences


def test_its_lips_close_when_those_of_the_voice_do(hama: HamaRecogniser, spoken: tuple[Speech, ...]) -> None:
    closed = seen = 0
    for speech in spoken:
        result = heard(hama, speech.samples, speech.rate)
        for phone in speech.phones:
            if phone.symbol in ("M", "B", "P"):
                closed += 1
                seen += any(p.symbol in ("M", "B", "P") and p.start < phone.end and p.end > phone.start for p in result)
    assert closed >= 6
    assert seen / closed > 0.8


def test_it_hears_a_real_talker(hama: HamaRecogniser, clips: tuple[Clip, ...]) -> None:
    distances = []  # the corpus counts a breath or a click before a word as the word now and then
    for clip in clips:
        result = heard(hama, clip.samples, clip.rate)
        assert clip.transcript.words is not None
        first, last = clip.transcript.words[0], clip.transcript.words[-1]
        sounding = [phone for phone in result if phone.symbol != SILENCE]
        distances += [abs(sounding[0].start - first.start), abs(sounding[-1].end - last.end)]
        assert 8 <= len(sounding) <= 30
    assert np.median(distances) < 0.1


@pytest.mark.parametrize("level", [0.0, 1e-4, 1e-3, 1e-2, 1e-1])
def test_noise_is_no_speech(hama: HamaRecogniser, level: float) -> None:
    noise = np.random.default_rng(0).normal(0, level, 2 * RATE).astype(np.float32)
    assert hama.hear(np.clip(noise, -1, 1)) == []


def test_very_short_and_empty_sound_is_silence(hama: HamaRecogniser) -> None:
    assert hama.hear(np.zeros(0, np.float32)) == []
    assert hama.hear(np.full(1, 0.5, np.float32)) == []


def test_times_do_not_depend_on_what_is_put_before(hama: HamaRecogniser, spoken: tuple[Speech, ...]) -> None:
    sound = soxr.resample(spoken[0].samples, spoken[0].rate, RATE).astype(np.float32)
    whole = hama.hear(sound)
    part = hama.hear(sound[: round(0.8 * RATE)])  # short: noise is put before it
    early = [each for each in whole if each.at < 0.5]
    assert [each.symbol for each in part][: len(early)] == [each.symbol for each in early]
    assert [each.at for each in part][: len(early)] == pytest.approx([each.at for each in early], abs=0.045)


def test_it_may_be_used_from_several_threads(hama: HamaRecogniser, spoken: tuple[Speech, ...]) -> None:
    sounds = [soxr.resample(speech.samples, speech.rate, RATE).astype(np.float32) for speech in spoken]
    alone = [hama.hear(sound) for sound in sounds]
    together: dict[int, object] = {}

    def work(number: int) -> None:
        together[number] = hama.hear(sounds[number])

    threads = [threading.Thread(target=work, args=(number,)) for number in range(len(sounds))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [together[number] for number in range(len(sounds))] == alone


def test_an_engine_that_fails_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    recogniser = HamaRecogniser()
    recogniser.warm_up()

    def broken(*_: object) -> None:
        raise ValueError("weights")

    monkeypatch.setattr(recogniser._model, "transcribe_waveform", broken)
    with pytest.raises(RecognitionFailed, match="hama: ValueError: weights"):
        recogniser.hear(np.full(RATE, 0.1, np.float32))
