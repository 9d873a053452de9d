from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from app.align.dictionary import NO_LEXICON, Lexicon
from app.errors import InputError, NotFound, NothingToSay, SpeechFailed
from app.speech import SILENCE, Phone, Speech, Word
from app.tts.mock import MockEngine
from app.tts.narrate import check, narrate, with_pause
from app.tts.planning import plan
from app.tts.text import PARAGRAPH_PAUSE, SENTENCE_PAUSE

GOOD = MockEngine().speak("hello there", voice="mock")


class Counting(MockEngine):
    def __init__(self) -> None:
        self.spoken: list[str] = []

    def speak(self, text: str, *, voice: str = "", speed: float = 1.0, lexicon: Lexicon = NO_LEXICON) -> Speech:
        self.spoken.append(text)
        if "fail" in text:
            raise ZeroDivisionError("oops")
        if "mute" in text:
            raise NothingToSay("nothing")
        return super().speak(text, voice=voice, speed=speed, lexicon=lexicon)


def test_plan() -> None:
    planned = plan("Hi 😀. Bye.")
    assert [clause.text for clause in planned.clauses] == ["Hi.", "Bye."]
    assert planned.unread == ("😀",)


def test_words_that_no_dictionary_has_are_told() -> None:
    assert plan("Ask Qwyxzk or (Zzyxq), twice: qwyxzk?").guessed == ("Qwyxzk", "Zzyxq")
    assert plan("Hello to all of you.").guessed == ()


def test_a_lexicon_says_how_words_are_said() -> None:
    planned = plan("So, Qwyxzk!", lexicon={"qwyxzk": "K W IH1 K"})
    assert planned.guessed == ()
    (speech,) = narrate(MockEngine(), planned)
    assert [phone.symbol for phone in speech.phones if phone.symbol != "SIL"] == ["S", "OW", "K", "W", "IH", "K"]
    with pytest.raises(InputError, match="'XX', which is no phone"):
        plan("Hello", lexicon={"hello": "XX"})


def test_pieces_are_spoken_only_when_asked_for() -> None:
    engine = Counting()
    speeches = narrate(engine, "One. Two. Three.")
    assert engine.spoken == []
    next(speeches)
    assert engine.spoken == ["One."]
    assert len(list(speeches)) == 2


def test_pieces_joined_are_the_whole_with_its_pauses() -> None:
    first, second = narrate(MockEngine(), "One 你好.\n\nTwo.", voice="mock")
    for piece, pause in ((first, PARAGRAPH_PAUSE), (second, SENTENCE_PAUSE)):
        check(piece, "mock")
        assert piece.phones[-1].symbol == SILENCE != piece.phones[-2].symbol
        assert piece.phones[-1].end == pytest.approx(piece.duration)
        assert piece.phones[-1].end - piece.phones[-1].start >= pause
        assert not piece.samples[-round(pause * piece.rate) :].any()
    assert first.unread == ("你好",)
    assert second.unread == ()


def test_pauses_follow_the_speed() -> None:
    slow, fast = (next(narrate(MockEngine(), "One. Two.", speed=speed)) for speed in (0.5, 2.0))
    assert slow.duration == pytest.approx(4 * fast.duration, rel=0.01)


def test_a_plan_can_be_narrated() -> None:
    assert len(list(narrate(MockEngine(), plan("One. Two.")))) == 2


@pytest.mark.parametrize("text", ["", "...", " \n", "😀", "你好", "\x00"])
def test_nothing_to_say_is_known_at_once(text: str) -> None:
    with pytest.raises(NothingToSay) as caught:
        narrate(MockEngine(), text)
    assert caught.value.field == "text"


def test_a_mute_piece_is_skipped_but_not_all_of_them() -> None:
    (piece,) = narrate(Counting(), "mute 😀. Sound.")
    assert [word.text for word in piece.words] == ["Sound."]
    assert piece.unread == ("😀",)
    with pytest.raises(NothingToSay):
        list(narrate(Counting(), "mute. mute."))


@pytest.mark.parametrize("speed", [0.0, 0.49, 2.01, float("nan"), float("inf"), -1.0])
def test_speed_is_limited(speed: float) -> None:
    with pytest.raises(InputError, match="speed"):
        narrate(MockEngine(), "hi", speed=speed)


def test_errors_of_an_engine_name_it() -> None:
    speeches = narrate(Counting(), "Good. Then fail.")
    next(speeches)
    with pytest.raises(SpeechFailed, match=r"mock.*ZeroDivisionError.*oops"):
        next(speeches)
    with pytest.raises(NotFound):
        next(narrate(MockEngine(), "hi", voice="nobody"))


def test_with_pause() -> None:
    bare = Speech(np.ones(10, np.float32), 10, (Phone("AA", 0.0, 1.0),))
    assert with_pause(bare, 0.0) is bare
    paused = with_pause(bare, 0.5)
    assert paused.phones == (Phone("AA", 0.0, 1.0), Phone(SILENCE, 1.0, 1.5))
    assert with_pause(paused, 0.5).phones == (Phone("AA", 0.0, 1.0), Phone(SILENCE, 1.0, 2.0))


def moved(speech: Speech, at: int, **changes: float) -> Speech:
    phones = list(speech.phones)
    phones[at] = replace(phones[at], **changes)
    return replace(speech, phones=tuple(phones))


@pytest.mark.parametrize(
    ("spoil", "what"),
    [
        (lambda s: replace(s, samples=s.samples * np.nan), "finite"),
        (lambda s: replace(s, samples=s.samples.astype(np.float64)), "float32"),
        (lambda s: replace(s, samples=s.samples[None]), "shape"),
        (lambda s: replace(s, samples=s.samples[:0]), "shape"),
        (lambda s: replace(s, samples=s.samples * 9), "exceed"),
        (lambda s: replace(s, samples=s.samples[:-100]), "end at"),
        (lambda s: replace(s, rate=0), "rate"),
        (lambda s: replace(s, phones=()), "no phones"),
        (lambda s: replace(s, phones=s.phones[1:]), "follow"),
        (lambda s: replace(s, phones=s.phones[:-1]), "end at"),
        (lambda s: moved(s, 2, end=s.phones[2].start), "follow"),
        (lambda s: moved(s, 2, start=s.phones[2].start + 0.01), "follow"),
        (lambda s: moved(s, 2, end=float("nan")), "follow"),
        (lambda s: replace(s, phones=(*s.phones[:-1], replace(s.phones[-1], symbol="XX"))), "XX"),
        (lambda s: replace(s, words=s.words[::-1]), "order"),
        (lambda s: replace(s, words=(Word("x", 0.0, 99.0),)), "order"),
    ],
)
def test_unsound_speech_is_refused(spoil: Callable[[Speech], Speech], what: str) -> None:
    assert check(GOOD, "mock") is GOOD
    with pytest.raises(SpeechFailed, match=what) as caught:
        check(spoil(GOOD), "somebody")
    assert "somebody" in caught.value.message
