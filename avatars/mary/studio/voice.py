"""The sound of the recording: the service's own voice says the sentences, and tells when each phone sounds."""

from __future__ import annotations

import wave
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.speech import SILENCE, Phone, Speech, Word
from app.tts.hibari import HibariEngine
from avatars.mary.studio.sentences import SENTENCES
from avatars.mary.studio.workspace import Workspace, write_json

BEFORE = 0.48  # seconds before the first phone
BETWEEN = 0.50  # from the last phone of a sentence to the first of the next
AFTER = 0.72  # after the last phone
LOUDEST = 0.85  # of full scale


def speak(workspace: Workspace) -> None:
    """Write sound, sentences, words and phones."""
    engine = HibariEngine()
    speech, sentences = joined([engine.speak(sentence) for sentence in SENTENCES])
    _write_wave(workspace.sound, speech.samples / np.abs(speech.samples).max() * LOUDEST, speech.rate)
    write_json(workspace.phones, [[phone.symbol, phone.start, phone.end] for phone in speech.phones])
    write_json(workspace.words, [[word.text, word.start, word.end] for word in speech.words])
    spoken = zip(SENTENCES, sentences, strict=True)
    content = [{"text": text, "start": round(start, 3), "end": round(end, 3)} for text, (start, end) in spoken]
    write_json(workspace.sentences, content, indent=1)


def joined(spoken: Sequence[Speech]) -> tuple[Speech, list[tuple[float, float]]]:
    """Sentences one after the other with pauses, and when each of them starts and ends (seconds)."""
    rate = spoken[0].rate
    at = BEFORE
    phones: list[Phone] = []
    words: list[Word] = []
    spans: list[tuple[float, float]] = []
    placed: list[tuple[int, NDArray[np.float32]]] = []
    for speech in spoken:
        said = [phone for phone in speech.phones if phone.symbol != SILENCE]
        first = round((at - said[0].start) * rate)
        shift = first / rate
        placed.append((first, speech.samples))
        silence = phones[-1].end if phones else 0.0
        phones.append(Phone(SILENCE, silence, _time(said[0].start + shift)))
        start, *_, end = (index for index, phone in enumerate(speech.phones) if phone.symbol != SILENCE)
        phones += [_moved(phone, shift) for phone in speech.phones[start : end + 1]]
        words += [Word(word.text, _time(word.start + shift), _time(word.end + shift)) for word in speech.words]
        spans.append((said[0].start + shift, said[-1].end + shift))
        at = spans[-1][1] + BETWEEN
    samples = np.zeros(round((spans[-1][1] + AFTER) * rate), np.float32)
    for first, sound in placed:
        samples[first : first + len(sound)] += sound
    phones.append(Phone(SILENCE, phones[-1].end, _time(len(samples) / rate)))
    return Speech(samples, rate, tuple(phones), tuple(words)), spans


def _moved(phone: Phone, shift: float) -> Phone:
    return Phone(phone.symbol, _time(phone.start + shift), _time(phone.end + shift))


def _time(seconds: float) -> float:
    """To a tenth of a millisecond; neighbours stay neighbours, because both are rounded alike."""
    return round(seconds, 4)


def _write_wave(path: Path, samples: NDArray[np.float32], rate: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes((samples * 32767).astype("<i2").tobytes())
