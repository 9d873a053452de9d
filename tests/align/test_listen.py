import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.align.aligner import DOUBTFUL
from app.align.listen import AROUND, LONGEST_PIECE, OUT_RATE, align_recording, cut, recognise_recording
from app.align.mock import MockAligner
from app.align.mock_recogniser import MockRecogniser
from app.align.pocketsphinx import PocketSphinxAligner
from app.errors import InputError
from app.speech import SILENCE, Phone, Speech, Word


def hum(seconds: float, rate: int = 16_000) -> np.ndarray:
    return (0.3 * np.sin(2 * np.pi * 200 * np.arange(round(seconds * rate)) / rate)).astype(np.float32)


def test_a_recording_with_its_text_has_words_and_is_brought_to_the_streams_rate() -> None:
    listened = align_recording(hum(1.0), 16_000, "hello you", MockAligner())
    assert [word.text for word in listened.speech.words] == ["hello", "you"]
    assert (len(listened.speech.samples), listened.speech.rate) == (OUT_RATE, OUT_RATE)
    assert listened.confidence == 1
    assert not listened.doubtful


def test_without_a_text_phones_are_heard() -> None:
    listened = recognise_recording(hum(1.0, 24_000), 24_000, MockRecogniser())
    assert listened.speech.words == ()
    assert {phone.symbol for phone in listened.speech.phones} >= {"AA", "M"}
    assert listened.confidence is None
    assert not listened.doubtful
    assert [piece.recognised for piece in cut(listened.speech)] == [True]
    assert not align_recording(hum(1.0), 16_000, "hello you", MockAligner()).speech.recognised


def test_another_text_is_doubtful_and_refused_when_strict(
    spoken: tuple[Speech, ...], sphinx: PocketSphinxAligner
) -> None:
    speech = spoken[0]
    text = " ".join(word.text for word in spoken[1].words)
    listened = align_recording(speech.samples, speech.rate, text, sphinx)
    assert listened.confidence is not None
    assert listened.confidence < DOUBTFUL
    assert listened.doubtful
    with pytest.raises(InputError, match="does not seem to be what is said") as error:
        align_recording(speech.samples, speech.rate, text, sphinx, strict=True)
    assert error.value.field == "text"


def test_guessed_words_are_told(spoken: tuple[Speech, ...], sphinx: PocketSphinxAligner) -> None:
    listened = align_recording(spoken[0].samples, spoken[0].rate, "Shee sells sea shellz by the sea shore.", sphinx)
    assert "shellz" in listened.guessed


@settings(max_examples=60, deadline=None)
@given(
    lengths=st.lists(st.tuples(st.floats(0.03, 6.0), st.booleans()), min_size=1, max_size=40),
    rate=st.sampled_from([8_000, 48_000]),
)
def test_cut_speech_is_the_whole_of_it(lengths: list[tuple[float, bool]], rate: int) -> None:
    ends = np.cumsum([length for length, _ in lengths]).tolist()
    samples = np.arange(round(ends[-1] * rate), dtype=np.float32)
    ends[-1] = len(samples) / rate
    starts = [0.0, *ends[:-1]]
    phones = tuple(
        Phone(SILENCE if quiet else "AA", start, end)
        for start, end, (_, quiet) in zip(starts, ends, lengths, strict=True)
    )
    words = tuple(Word(str(n), phone.start, phone.end) for n, phone in enumerate(phones))
    pieces = list(cut(Speech(samples, rate, phones, words)))
    np.testing.assert_array_equal(np.concatenate([piece.samples for piece in pieces]), samples)
    assert [word.text for piece in pieces for word in piece.words] == [word.text for word in words]
    at = 0.0
    for piece in pieces:
        assert piece.duration <= LONGEST_PIECE + 2 / rate
        assert piece.phones[0].start == 0
        assert piece.phones[-1].end == pytest.approx(piece.duration)
        assert piece.around[0].start <= 0
        assert piece.around[-1].end >= piece.duration - 1e-6
        end = round((at + piece.duration) * rate)
        assert piece.ahead is not None
        assert len(piece.ahead) == min(round(AROUND * rate), len(samples) - end)
        np.testing.assert_array_equal(piece.ahead, samples[end : end + len(piece.ahead)])
        for word in piece.words:
            assert at + word.start == pytest.approx(words[int(word.text)].start)
        at += piece.duration


def test_it_is_cut_in_pauses() -> None:
    phones, at = [], 0.0
    for _ in range(12):
        phones += [Phone("AA", at, at + 0.9), Phone(SILENCE, at + 0.9, at + 1.2)]
        at += 1.2
    pieces = list(cut(Speech(np.zeros(round(at * 48_000), np.float32), 48_000, tuple(phones))))
    assert len(pieces) > 3
    for piece in pieces[:-1]:
        assert piece.phones[-1].symbol == SILENCE
