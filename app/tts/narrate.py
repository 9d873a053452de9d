"""Speaks a whole text piece by piece: sound for the first piece is there before the rest is even begun."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from app.errors import InputError, MaryError, NothingToSay, SpeechFailed
from app.speech import PHONES, SILENCE, Mark, Phone, Speech
from app.tts.clause import Clause
from app.tts.engine import SpeechEngine
from app.tts.planning import Plan, nothing, plan
from app.tts.words import as_written

SLOWEST, FASTEST = 0.5, 2.0
_SYMBOLS = frozenset(PHONES)


def narrate(engine: SpeechEngine, text: str | Plan, *, voice: str = "", speed: float = 1.0) -> Iterator[Speech]:
    """Speak a text; each piece is spoken when it is asked for.

    The silence after a piece belongs to it, so pieces joined end to end are the whole speech. What the text holds that
    cannot be read is in the first piece's `unread`.

    Args:
        engine: speaks the pieces.
        text: any text, or the plan already made of it.
        voice: a voice's id, empty for the engine's default.
        speed: 0.5 to 2; pauses follow it.

    Raises:
        NothingToSay: no readable text (at once), or none that the engine can speak (at the end).
        InputError: speed out of range (at once).
        SpeechFailed: the engine failed or made unsound speech.
    """
    check_speed(speed)
    return _something(engine, text if isinstance(text, Plan) else plan(text), voice, speed)


def check_speed(speed: float) -> None:
    """Raise InputError if nobody speaks so slowly or so fast."""
    if not SLOWEST <= speed <= FASTEST:
        raise InputError(f"speed must be from {SLOWEST} to {FASTEST}, not {speed}", field="speed")


def _something(engine: SpeechEngine, planned: Plan, voice: str, speed: float) -> Iterator[Speech]:
    spoken = False
    for speech in speak(engine, planned, voice=voice, speed=speed):
        yield speech
        spoken = True
    if not spoken:
        raise nothing(planned.unread)


def speak(engine: SpeechEngine, planned: Plan, *, voice: str, speed: float) -> Iterator[Speech]:
    """Speak the pieces of a plan as in `narrate`; without anything that the engine can speak there is no speech.

    Raises:
        SpeechFailed: as in `narrate`.
    """
    unread = planned.unread
    passed: tuple[str, ...] = ()  # marks of clauses that made no sound
    for clause in planned.clauses:
        pace = min(max(speed * clause.speed, SLOWEST), FASTEST)
        lexicon = {**planned.lexicon, **clause.lexicon} if clause.lexicon else planned.lexicon
        try:
            speech = check(engine.speak(clause.spoken, voice=voice, speed=pace, lexicon=lexicon), engine.name)
        except NothingToSay:
            passed += tuple(mark.name for mark in clause.marks)
            continue
        except MaryError:
            raise
        except Exception as error:  # an engine's own error, whatever it is, must name the engine
            raise SpeechFailed(f"speech engine {engine.name} failed: {type(error).__name__}: {error}") from error
        speech = with_gain(_in_place(speech, clause, passed), clause.gain)
        speech = with_pause(speech, clause.pause / pace + clause.silence)
        yield replace(speech, unread=tuple(dict.fromkeys((*unread, *speech.unread))))
        unread, passed = (), ()


def _in_place(speech: Speech, clause: Clause, passed: tuple[str, ...]) -> Speech:
    """Speech of a clause with its silence before it, the words as they are written, and the marks at their places."""
    speech = with_lead(speech, clause.lead)
    times = as_written(speech.words, [reading.spoken for reading in clause.readings])
    words = tuple(
        replace(word, text=reading.text)
        for reading, word in zip(clause.readings, times, strict=True)
        if word is not None
    )
    marks = [Mark(name, 0.0) for name in passed]
    latest = 0.0
    for place in clause.marks:
        if place.reading < 0:
            latest = max(latest, place.after)
        else:
            word = next((word for word in times[place.reading :] if word is not None), None)
            end = speech.duration + place.after if place.reading >= len(times) else _end_of_sound(speech)
            latest = max(latest, word.start if word is not None else end)
        marks.append(Mark(place.name, latest))
    return replace(speech, words=words, marks=tuple(marks))


def _end_of_sound(speech: Speech) -> float:
    last = speech.phones[-1]
    return last.start if last.symbol == SILENCE else last.end


def with_gain(speech: Speech, gain: float) -> Speech:
    """The same speech `gain` decibels louder, but never over 1."""
    if gain == 0:
        return speech
    peak = float(np.abs(speech.samples).max())
    factor = 10 ** (gain / 20)
    if peak * factor > 1:
        factor = 1 / peak
    samples = np.clip(speech.samples * np.float32(factor), -1, 1).astype(np.float32)
    return replace(speech, samples=samples)


def with_lead(speech: Speech, seconds: float) -> Speech:
    """The same speech with silence before it, as part of its first silence or as a new one."""
    extra = round(seconds * speech.rate)
    if extra <= 0:
        return speech
    shift = extra / speech.rate
    phones = [Phone(phone.symbol, phone.start + shift, phone.end + shift) for phone in speech.phones]
    if phones[0].symbol == SILENCE:
        phones[0] = replace(phones[0], start=0.0)
    else:
        phones.insert(0, Phone(SILENCE, 0.0, shift))
    return replace(
        speech,
        samples=np.concatenate([np.zeros(extra, np.float32), speech.samples]),
        phones=tuple(phones),
        words=tuple(replace(word, start=word.start + shift, end=word.end + shift) for word in speech.words),
    )


def with_pause(speech: Speech, seconds: float) -> Speech:
    """The same speech with silence after it, as part of its last silence or as a new one."""
    extra = round(seconds * speech.rate)
    if extra <= 0:
        return speech
    samples = np.concatenate([speech.samples, np.zeros(extra, np.float32)])
    end = len(samples) / speech.rate
    last = speech.phones[-1]
    if last.symbol == SILENCE:
        phones = (*speech.phones[:-1], Phone(SILENCE, last.start, end))
    else:
        phones = (*speech.phones, Phone(SILENCE, last.end, end))
    return replace(speech, samples=samples, phones=phones)


def check(speech: Speech, engine: str) -> Speech:
    """The speech itself if it is sound; every engine's result goes through here.

    Raises:
        SpeechFailed: names the engine and what is wrong: samples that are not finite float32 in one row, phones that
            are unknown, overlap, leave gaps or do not span the sound from 0 to its end, words out of order.
    """
    samples, phones = speech.samples, speech.phones
    tolerance = 1.0 / speech.rate if speech.rate > 0 else 0.0  # one sample

    def wrong(what: str) -> SpeechFailed:
        return SpeechFailed(f"speech engine {engine}: {what}")

    if speech.rate <= 0:
        raise wrong(f"sample rate {speech.rate}")
    if samples.ndim != 1 or samples.dtype != np.float32 or not len(samples):
        raise wrong(f"samples must be float32 of shape (n,), not {samples.dtype} of shape {samples.shape}")
    if not np.isfinite(samples).all():
        raise wrong("samples are not finite")
    if float(np.abs(samples).max()) > 1.0:
        raise wrong("samples exceed 1")
    if not phones:
        raise wrong("no phones")
    edge = 0.0
    for phone in phones:
        if phone.symbol not in _SYMBOLS:
            raise wrong(f"unknown phone {phone.symbol!r}")
        if abs(phone.start - edge) > tolerance or not phone.end > phone.start:
            raise wrong(
                f"phone {phone.symbol} from {phone.start:.3f} to {phone.end:.3f} s does not follow {edge:.3f} s"
            )
        edge = phone.end
    if abs(edge - speech.duration) > tolerance:
        raise wrong(f"phones end at {edge:.3f} s, the sound at {speech.duration:.3f} s")
    edge = 0.0
    for word in speech.words:
        if word.start < edge - tolerance or word.end < word.start or word.end > speech.duration + tolerance:
            raise wrong(f"word {word.text!r} from {word.start:.3f} to {word.end:.3f} s is out of order")
        edge = word.end
    return speech
