import re
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ssml_documents import DOCUMENT

from app.align.dictionary import NO_LEXICON, Lexicon
from app.errors import InputError, NotFound, NothingToSay, SpeechFailed
from app.speech import SILENCE, Mark, Phone, Speech, Word
from app.tts.mock import MockEngine
from app.tts.narrate import check, narrate, with_pause
from app.tts.planning import plan
from app.tts.splitting import PARAGRAPH_PAUSE, SENTENCE_PAUSE

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


# --- SSML and readings ------------------------------------------------------------------------------------------------


def spoken(inner: str, *, speed: float = 1.0) -> list[Speech]:
    return [check(speech, "mock") for speech in narrate(MockEngine(), f"<speak>{inner}</speak>", speed=speed)]


def test_words_are_those_written_and_cover_what_is_said() -> None:
    (speech,) = narrate(MockEngine(), 'It costs $3.50 "now".')
    assert [word.text for word in speech.words] == ["It", "costs", "$3.50", '"now".']
    said = MockEngine().speak("It costs three dollars and fifty cents now.").words
    assert (speech.words[2].start, speech.words[2].end) == (said[2].start, said[6].end)
    assert speech.words[3].start == said[7].start


def test_marks_are_reached_when_their_word_begins() -> None:
    first, second = spoken('One <mark name="a"/>$2<mark name="b"/>. <break time="1s"/><mark name="c"/>Three.')
    assert [mark.name for mark in first.marks] == ["a", "b"]
    assert first.marks[0].time == first.words[1].start
    assert first.words[1].end <= first.marks[1].time == pytest.approx(first.duration - 1.0)
    assert second.marks == (Mark("c", second.words[0].start),)


def test_silence_before_the_first_word() -> None:
    (plain,), (late,) = spoken("One."), spoken('<break time="1s"/><mark name="a"/><break time="1s"/>One.')
    assert late.duration == pytest.approx(plain.duration + 2)
    assert late.words[0].start == pytest.approx(plain.words[0].start + 2)
    assert not late.samples[: 2 * late.rate].any()
    assert late.phones[0].end == pytest.approx(plain.phones[0].end + 2)
    assert late.marks == (Mark("a", 1.0),)


def test_breaks_keep_their_time_at_any_speed() -> None:
    for speed in (0.5, 2.0):
        first, _ = spoken('One.<break time="1s"/>Two.', speed=speed)
        (bare,) = spoken('One.<break strength="none"/>', speed=speed)
        assert first.duration == pytest.approx(bare.duration + 1.0)


@pytest.mark.parametrize(
    ("rate", "speed", "pace"), [("50%", 1.0, 0.5), ("50%", 0.75, 0.5), ("400%", 1.0, 2.0), ("2", 0.5, 1.0)]
)
def test_rate_multiplies_the_speed_within_bounds(rate: str, speed: float, pace: float) -> None:
    (speech,) = spoken(f'<prosody rate="{rate}">One two.</prosody>', speed=speed)
    (plain,) = spoken("One two.", speed=pace)
    assert speech.duration == pytest.approx(plain.duration)


def test_volume_is_a_gain_that_never_clips() -> None:
    (plain,), (soft,), (loud,), (silent,) = (
        spoken(f'<prosody volume="{volume}">One.</prosody>') for volume in ("medium", "-6dB", "+20dB", "silent")
    )
    np.testing.assert_allclose(soft.samples, plain.samples * 10 ** (-6 / 20), atol=1e-6)
    assert float(np.abs(loud.samples).max()) == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(loud.samples, plain.samples / np.abs(plain.samples).max(), atol=1e-5)
    assert not silent.samples.any()
    assert silent.words == plain.words


def test_a_clause_without_sound_keeps_its_marks() -> None:
    speeches = list(narrate(Counting(), '<speak><s>mute<mark name="a"/></s><s>Sound.</s></speak>'))
    assert [speech.marks for speech in speeches] == [(Mark("a", 0.0),)]


def test_phonemes_are_said_with_the_lexicon_of_the_text() -> None:
    planned = plan('<speak><phoneme ph="ɹɛd">read</phoneme> Nguyen</speak>', lexicon={"Nguyen": "W IH N"})
    (speech,) = narrate(MockEngine(), planned)
    assert [phone.symbol for phone in speech.phones if phone.symbol != SILENCE] == ["R", "EH", "D", "W", "IH", "N"]
    assert [word.text for word in speech.words] == ["read", "Nguyen"]


SCRAPS = st.sampled_from([
    "Hello", ". ", ", ", " ", "\n\n", "$3.50", "Jan. 5th", "10:30 pm", "NASA", "😀", "你", "**", "`", "# ", "½",
    "www.a.com", "<", "&", "<speak>", "é", "\u0301", "\u202e", "\ud800", "\x00", "IV", "x", "-", "5", "'", '"',
])  # fmt: skip


def heard_whole(speeches: Iterator[Speech]) -> int:
    """Go through the speech of a text; every piece is sound, and its marks and words lie within it and in order."""
    pieces = 0
    for speech in speeches:
        check(speech, "mock")
        assert speech.phones[0].start == 0
        assert speech.phones[-1].end == pytest.approx(speech.duration)
        times = [mark.time for mark in speech.marks]
        assert times == sorted(times)
        assert all(0 <= time <= speech.duration + 1e-9 for time in times)
        pieces += 1
    return pieces


@settings(deadline=None, max_examples=60)
@given(st.one_of(st.text(max_size=60), st.lists(SCRAPS, max_size=25).map("".join)))
def test_any_text_is_spoken_or_refused_with_a_reason(text: str) -> None:
    try:
        assert heard_whole(narrate(MockEngine(), plan(text, markup="text")))
    except NothingToSay:
        assert not any("a" <= letter <= "z" for letter in text.lower())


@settings(deadline=None, max_examples=60)
@given(DOCUMENT)
def test_any_document_is_spoken_or_refused_with_a_reason(document: str) -> None:
    try:
        planned = plan(document)
        assert heard_whole(narrate(MockEngine(), planned))
    except InputError:  # a say-as that cannot be, an empty element, or nothing to say
        return
    names = [mark.name for speech in narrate(MockEngine(), planned) for mark in speech.marks]
    assert names == re.findall(r'<mark name="([^"]*)"', document)
