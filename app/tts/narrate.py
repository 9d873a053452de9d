"""Speaks a whole text piece by piece: sound for the first piece is there before the rest is even begun."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from app.align.dictionary import NO_LEXICON, Dictionary, Lexicon, folded, read_lexicon
from app.errors import InputError, MaryError, NothingToSay, SpeechFailed
from app.speech import PHONES, SILENCE, Phone, Speech
from app.tts.engine import SpeechEngine
from app.tts.text import Clause, clean, split

SLOWEST, FASTEST = 0.5, 2.0
_SYMBOLS = frozenset(PHONES)
_AROUND = ".,;:!?…—()[]{}\"'"  # of a word


@dataclass(frozen=True, slots=True)
class Plan:
    """What will be said.

    Attributes:
        clauses: the pieces to speak, at least one.
        unread: what of the text cannot be read.
        guessed: words, each once as they are written, that neither the lexicon nor the dictionary has.
        lexicon: how some of the words are to be said.
    """

    clauses: tuple[Clause, ...]
    unread: tuple[str, ...]
    guessed: tuple[str, ...] = ()
    lexicon: Lexicon = field(default_factory=lambda: NO_LEXICON)


def plan(text: str, *, lexicon: Mapping[str, str | Sequence[str]] = NO_LEXICON) -> Plan:
    """Clean and split a text without speaking it; quick enough for the request that brings the text.

    Args:
        text: any.
        lexicon: see `app.align.dictionary.read_lexicon`.

    Raises:
        NothingToSay: no readable text.
        InputError: the lexicon has a pronunciation that is none.
    """
    own = read_lexicon(lexicon) if lexicon else NO_LEXICON
    cleaned = clean(text)
    clauses = split(cleaned.text)
    if not clauses:
        raise _nothing(cleaned.unread)
    words = Dictionary().with_lexicon(own).read(" ".join(clause.text for clause in clauses))
    guessed: dict[str, str] = {}
    for word in words:
        if word.guessed:
            guessed.setdefault(folded(word.text), word.text.strip(_AROUND))
    return Plan(clauses, cleaned.unread, tuple(guessed.values()), own)


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
        raise _nothing(planned.unread)


def speak(engine: SpeechEngine, planned: Plan, *, voice: str, speed: float) -> Iterator[Speech]:
    """Speak the pieces of a plan as in `narrate`; without anything that the engine can speak there is no speech.

    Raises:
        SpeechFailed: as in `narrate`.
    """
    unread = planned.unread
    for clause in planned.clauses:
        try:
            speech = check(engine.speak(clause.text, voice=voice, speed=speed, lexicon=planned.lexicon), engine.name)
        except NothingToSay:
            continue
        except MaryError:
            raise
        except Exception as error:  # an engine's own error, whatever it is, must name the engine
            raise SpeechFailed(f"speech engine {engine.name} failed: {type(error).__name__}: {error}") from error
        speech = with_pause(speech, clause.pause / speed)
        yield replace(speech, unread=tuple(dict.fromkeys((*unread, *speech.unread))))
        unread = ()


def _nothing(unread: tuple[str, ...]) -> NothingToSay:
    found = f"; {', '.join(unread)[:80]} cannot be read" if unread else ""
    return NothingToSay(f"the text has nothing to say{found}", field="text", advice="Send some words in Latin letters.")


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
